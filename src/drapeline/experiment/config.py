"""Checks of an experiment's settings against a closed JSON schema, which fills in defaults."""

import copy
import math
import reprlib
from collections.abc import Iterable, Mapping
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from drapeline.errors import InputError
from drapeline.settings import expectation, unknown_setting


def fill_settings(
    settings: Mapping[str, Any], schema: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """A copy of `settings` with every default of `schema` filled in.

    Args:
        settings: nested mappings as read from YAML.
        schema: JSON schema whose objects are closed and whose keys have defaults; those of objects
            are empty. An object with the keyword `overrides` has a default of its own and none for
            its keys.
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
    # What the settings of a group do not override holds as it does for all.
    overrides = "overrides" in schema
    filled = {**schema["default"], **values} if overrides else dict(values)
    for key, part in parts.items() if not overrides else ():
        if "default" in part:
            filled.setdefault(key, part["default"])
    others = schema.get("additionalProperties")
    if not isinstance(others, Mapping):
        return {key: _fill(value, parts.get(key, {})) for key, value in filled.items()}
    # Named by the user, after those that there are in any case.
    names = [*parts, *(key for key in filled if key not in parts)]
    return {key: _fill(filled[key], parts.get(key, others)) for key in names if key in filled}


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
        inner: Iterable[tuple[Any, Any]] = ()
        if isinstance(value, Mapping):
            inner = value.items()
        elif isinstance(value, list | tuple | set):
            inner = enumerate(value)
        waiting += [(f"{key}.{name}" if key else str(name), part) for name, part in inner]
    raise InputError(f"{source}: holds more than {_MOST_VALUES} values, expected fewer aliases (*)")


def _sentence(error: ValidationError) -> str:
    key = ".".join(map(str, error.path)) or "the file"
    if error.validator == "additionalProperties":
        known = sorted(error.schema["properties"])
        unknown = sorted(set(error.instance) - set(known), key=str)
        prefix = "" if key == "the file" else f"{key}."
        return unknown_setting(f"{prefix}{unknown[0]}", str(unknown[0]), known)
    if error.validator == "dependentRequired":
        named, missing = next(
            (name, other)
            for name, needed in error.validator_value.items()
            for other in needed
            if name in error.instance and other not in error.instance
        )
        return f"{key} names {named} but no {missing}, expected both"
    return f"{key} is {reprlib.repr(error.instance)}, expected {expectation(error.schema)}"
