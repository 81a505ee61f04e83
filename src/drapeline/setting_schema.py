"""JSON schemas of settings in the form that configs are checked against, and in words.

Such a schema is closed and plain: no references, a default for every key, unions of a type and null
as a list of types. An object with the keyword `overrides` has a default of its own, its keys none.
"""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

_ORDER = (
    *("$schema", "title", "type", "enum", "pattern", "minimum", "exclusiveMinimum", "maximum"),
    *("multipleOf", "minLength", "minItems", "maxItems", "uniqueItems", "items"),
    *("additionalProperties", "anyOf", "default", "description", "dependentRequired"),
    *("overrides", "properties"),
)


def plain_schema(schema: Mapping[str, Any]) -> dict[str, Any]:
    """A JSON schema as pydantic writes it, in plain form.

    Titles remain where somebody gave one; descriptions of groups are the first paragraph of their
    docstring, if the field has none. Defaults of a group are those that it has in its place.
    """
    return _plain(schema, schema.get("$defs", {}))


def _plain(part: Mapping[str, Any], classes: Mapping[str, Any]) -> dict[str, Any]:
    if "$ref" in part:
        name = part["$ref"].rpartition("/")[2]
        own = {"title": None} if classes[name].get("title") == name else {}
        part = {**classes[name], **own, **{k: v for k, v in part.items() if k != "$ref"}}
    found = {key: value for key, value in part.items() if key not in ("$defs", "title")}
    if part.get("title"):
        found["title"] = part["title"]
    if "description" in found:
        found["description"] = " ".join(found["description"].partition("\n\n")[0].split())
    if "const" in found:
        found["enum"] = [found.pop("const")]
    if "anyOf" in found:
        found |= _union([_plain(option, classes) for option in found.pop("anyOf")])
    if "prefixItems" in found:  # a tuple whose items are alike
        found["items"] = found.pop("prefixItems")[0]
    if "items" in found:
        found["items"] = _plain(found["items"], classes)
    if "propertyNames" in found:
        found |= _mapping(found.pop("propertyNames"), found["additionalProperties"], classes)
    elif "properties" in found:
        if isinstance(found.get("additionalProperties"), Mapping):  # more of them, by any name
            found["additionalProperties"] = _plain(found["additionalProperties"], classes)
        found["properties"] = {
            key: _property(one, classes) for key, one in found["properties"].items()
        }
    if found.get("type") == "object":
        found.pop("required", None)
    return {key: found[key] for key in sorted(found, key=_ORDER.index)}


def _property(part: Mapping[str, Any], classes: Mapping[str, Any]) -> dict[str, Any]:
    """A field: its own title is made of its name, but that of a group was given to it."""
    own = {} if "$ref" in part else {"title": None}
    found = _plain({**part, **own}, classes)
    return _with_default(found, found["default"]) if "default" in found else found


def _with_default(part: Mapping[str, Any], default: Any) -> dict[str, Any]:
    """With defaults of the keys in place of a default of their group."""
    if not isinstance(default, Mapping) or "properties" not in part:
        # 1 is left as it was written; among those of a group it is 1.0.
        return part if part.get("default", ...) == default else {**part, "default": default}
    if "overrides" in part:
        own = {key: value for key, value in default.items() if value is not None}
        keys = {
            key: {name: value for name, value in one.items() if name != "default"}
            for key, one in part["properties"].items()
        }
        return {**part, "default": own, "properties": keys}
    keys = {
        key: _with_default(one, default[key]) if key in default else one
        for key, one in part["properties"].items()
    }
    return {**part, "default": {}, "properties": keys}


def _union(options: list[dict[str, Any]]) -> dict[str, Any]:
    """One schema for values of one of several types, where their other keys do not clash."""
    null = {"type": "null"}
    options, optional = [one for one in options if one != null], null in options
    kinds = [one.get("type") for one in options] + ["null"] * optional
    if len(options) > 1 and any("enum" in one for one in options):
        return {"anyOf": options}
    merged = {key: value for one in options for key, value in one.items() if key != "description"}
    merged |= {key: one[key] for one in options for key in ("description",) if key in one}
    if optional and "enum" in merged:
        merged["enum"] = [*merged["enum"], None]
    return {**merged, "type": kinds}


def _mapping(
    names: Mapping[str, Any], value: Mapping[str, Any], classes: Mapping[str, Any]
) -> dict[str, Any]:
    """Keys that may each be there or not."""
    properties = {name: _plain(value, classes) for name in names["enum"]}
    return {"additionalProperties": False, "properties": properties}


def unknown_setting(name: str, given: str, known: Iterable[str]) -> str:
    """The sentence for a key that does not exist.

    Args:
        name: of the key, as the message quotes it.
        given: its last part.
        known: the keys that exist in its place.
    """
    known = sorted(known)
    near = get_close_matches(given, known, n=1)
    meant = f"did you mean {near[0]}? expected" if near else "expected"
    return f"'{name}' is not a setting, {meant} one of {', '.join(known)}"


def expectation(schema: Mapping[str, Any]) -> str:
    """In words, what a key takes, and what it means."""
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
