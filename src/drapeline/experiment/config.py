"""Checks of an experiment's settings against a closed JSON schema, which fills in defaults."""

import copy
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
        return copy.deepcopy(values)
    parts = schema.get("properties", {})
    own = schema.get("default")
    filled = {**(own if isinstance(own, Mapping) else {}), **values}
    for key, part in parts.items():
        if "default" in part:
            filled.setdefault(key, part["default"])
    return {key: _fill(value, parts.get(key, {})) for key, value in filled.items()}


def _sentence(error: ValidationError) -> str:
    key = ".".join(map(str, error.path)) or "the file"
    if error.validator == "additionalProperties":
        known = sorted(error.schema["properties"])
        unknown = sorted(set(error.instance) - set(known))
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
    return f"{key} is {error.instance!r}, expected {_expectation(error.schema)}"


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
