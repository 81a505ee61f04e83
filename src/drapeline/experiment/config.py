"""Checks of an experiment's settings against a closed JSON schema, which fills in defaults."""

import copy
import math
import reprlib
from collections.abc import Mapping
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from drapeline.errors import InputError


def fill_settings(
    settings: Mapping[str, Any], schema: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """A copy of `settings` with every default of `schema` filled in.

    Args:
        settings: nested mappings as read from YAML.
        schema: JSON schema whose objects are closed and whose keys have defaults. What the default
            of an object names comes before the defaults of its keys, also where the object is
            given in part.
        source: name of the file the settings come from, for messages.

    Raises:
        InputError: names the key, its value and what is allowed, for the first problem.
    """
    _refuse_strange_values(settings, source)
    filled = _fill(settings, schema)
    problems = sorted(
        Draft202012Validator(schema).iter_errors(filled), key=lambda e: list(map(str, e.path))
    )
    if problems:
        raise InputError(f"{source}: {_sentence(problems[0])}")
    return filled


def _fill(values: Any, schema: Mapping[str, Any]) -> Any:
    """A copy in which nothing is shared: YAML's aliases are one object."""
    if not isinstance(values, Mapping):
        return _whole(copy.deepcopy(values), schema)
    parts = schema.get("properties", {})
    own = schema.get("default")
    filled = {**(own if isinstance(own, Mapping) else {}), **values}
    for key, part in parts.items():
        if "default" in part:
            filled.setdefault(key, part["default"])
    return {key: _fill(value, parts.get(key, {})) for key, value in filled.items()}


def _whole(value: Any, schema: Mapping[str, Any]) -> Any:
    """3.0 as 3 where the schema asks for whole numbers: JSON does not tell them apart."""
    if isinstance(value, list):
        return [_whole(item, schema.get("items", {})) for item in value]
    kinds = [part.get("type") for part in (schema, *schema.get("anyOf", []))]
    kinds = [kind for part in kinds for kind in (part if isinstance(part, list) else [part])]
    whole = isinstance(value, float) and "integer" in kinds and "number" not in kinds
    return int(value) if whole and value.is_integer() else value


_MOST_VALUES = 20_000


def _refuse_strange_values(settings: Mapping[str, Any], source: str) -> None:
    """Refuse NaN and infinity, and aliases of aliases, which no message could print.

    Raises:
        InputError: names the key.
    """
    waiting: list[tuple[str, Any]] = [("", settings)]
    for _ in range(_MOST_VALUES):
        if not waiting:
            return
        key, value = waiting.pop()
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{source}: {key} is {value}, expected a finite number")
        inner = value.items() if isinstance(value, Mapping) else ()
        if isinstance(value, list | tuple | set):
            inner = enumerate(value)
        waiting += [(f"{key}.{name}" if key else str(name), part) for name, part in inner]
    raise InputError(f"{source}: holds more than {_MOST_VALUES} values, expected fewer aliases (*)")


def _sentence(error: ValidationError) -> str:
    key = ".".join(map(str, error.path)) or "the file"
    if error.validator == "additionalProperties":
        known = sorted(error.schema["properties"])
        unknown = sorted(set(error.instance) - set(known), key=str)
        prefix = "" if key == "the file" else f"{key}."
        return f"'{prefix}{unknown[0]}' is not a setting, expected one of {', '.join(known)}"
    if error.validator == "dependentRequired":
        named, missing = next(
            (name, other)
            for name, needed in error.validator_value.items()
            for other in needed
            if name in error.instance and other not in error.instance
        )
        return f"{key} names {named} but no {missing}, expected both"
    return f"{key} is {reprlib.repr(error.instance)}, expected {_expectation(error.schema)}"


def _expectation(schema: Mapping[str, Any]) -> str:
    words = allowed_values(schema)
    if "description" in schema and "enum" not in schema:
        words += f" ({schema['description'].strip().rstrip('.')})"
    return words


def allowed_values(schema: Mapping[str, Any]) -> str:
    """In words, what a key takes by its JSON schema, such as "a number from 0 to 1"."""
    if "anyOf" in schema:
        return " or ".join(map(allowed_values, schema["anyOf"]))
    if "enum" in schema:
        return "one of " + ", ".join(map(str, schema["enum"]))
    kinds = schema.get("type", "value")
    kinds = [kinds] if isinstance(kinds, str) else list(kinds)
    named = " or ".join(kind for kind in kinds if kind != "null")
    words = ("an " if named[0] in "aeiou" else "a ") + named
    words += _between(schema.get("minimum"), schema.get("maximum"), schema.get("exclusiveMinimum"))
    words += _items(schema.get("minItems"), schema.get("maxItems"))
    if "enum" in schema.get("items", {}):
        words += " out of " + ", ".join(map(str, schema["items"]["enum"]))
    if schema.get("uniqueItems"):
        words += ", each named once"
    if "pattern" in schema:
        words += f" matching {schema['pattern']}"
    return words + (" or null" if "null" in kinds else "")


def _between(low: float | None, high: float | None, above: float | None = None) -> str:
    if above is not None:
        return f" above {above}" + (f" and at most {high}" if high is not None else "")
    if low is not None:
        return f" of at least {low}" if high is None else f" from {low} to {high}"
    return f" of at most {high}" if high is not None else ""


def _items(least: int | None, most: int | None) -> str:
    if least is None and most is None:
        return ""
    if least == most:
        return f" of exactly {least} items"
    if least is None:
        return f" of at most {most} items"
    return f" of {least} or more items" if most is None else f" of {least} to {most} items"
