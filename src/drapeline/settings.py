"""Settings: one declaration of type, default, range and meaning, for configs, Python and files.

    class Loss(Settings):
        '''Weights of the loss.'''

        mask: float = Field(0.5, ge=0, le=10_000, description="Weight of the mask.")

Rooms declare theirs in a module `settings`, which is quick to import. `experiment.settings` puts
them together to the whole config, whose schema and page of the documentation come from them. A
field with `SkipJsonSchema` is no key of a config: it is told by rules and written to checkpoints.
"""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
)
from pydantic.json_schema import GetJsonSchemaHandler, JsonSchemaValue, SkipJsonSchema

from drapeline.errors import InputError

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
        same = part.get("default", ...) == default
        return dict(part) if same else {**part, "default": default}
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


__all__ = ["ConfigDict", "EachOnce", "Field", "OneOf", "Settings", "Share", "SkipJsonSchema"]

Share = Annotated[float, Field(ge=0, le=1)]

Own = TypeVar("Own", bound="Settings")


class Settings(BaseModel):
    """Values of which each has a default and a range; they cannot be changed.

    Lists may stand for tuples and mappings for groups, as in YAML and checkpoints. A group that is
    given in part has the defaults of its place for the rest.

    Raises:
        InputError: a name is unknown, or a value out of range; names what is expected.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def __init__(self, **values: Any) -> None:
        defaults = {name: one.default for name, one in type(self).model_fields.items()}
        complete = _merged(defaults, values)
        try:
            super().__init__(**complete)
        except ValidationError as error:
            raise InputError(_sentence(type(self), complete, error)) from None

    def replace(self: Own, **changes: Any) -> Own:
        """A copy with other values; groups may be given in part."""
        return type(self)(**{**dict(self), **_merged(dict(self), changes)})

    def plain(self) -> dict[str, Any]:
        """Nested mappings and lists, as JSON and checkpoints hold them."""
        return self.model_dump(mode="json")

    @classmethod
    def schema_of_config(cls) -> dict[str, Any]:
        """The plain JSON schema of a config, or of a part of one, with these settings."""
        return plain_schema(cls.model_json_schema())


def _merged(current: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Changes whose groups are complete."""
    return {
        name: current[name].replace(**value)
        if isinstance(current.get(name), Settings) and isinstance(value, Mapping)
        else _as_tuple(value)
        for name, value in changes.items()
    }


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list | tuple) else value


def _sentence(cls: type[Settings], values: Mapping[str, Any], error: ValidationError) -> str:
    """The first problem."""
    first = error.errors()[0]
    if isinstance(cause := first.get("ctx", {}).get("error"), InputError):
        return str(cause)
    name = str(first["loc"][0])
    if first["type"] == "extra_forbidden":
        return f"{cls.__name__}: {unknown_setting(name, name, cls.model_fields)}"
    if first["type"] == "missing":
        return f"{cls.__name__}: {name} is missing, expected {cls.model_fields[name].description}"
    schema, value = cls.schema_of_config(), dict[Any, Any](values)
    path: list[str] = []
    for step in first["loc"]:
        inner = schema["items"] if isinstance(step, int) else schema.get("properties", {}).get(step)
        if inner is None:  # one of several types, or none of a config's keys
            break
        schema, path, value = inner, [*path, str(step)], value[step]
    if not path:
        return f"{cls.__name__}: {name} is {values[name]!r:.100}, expected {first['msg']}"
    return f"{cls.__name__}: {'.'.join(path)} is {value!r:.100}, expected {expectation(schema)}"


class OneOf(NamedTuple):
    """Marks a text that is one of some names, such as `Annotated[str, OneOf(GARMENTS)]`."""

    names: Sequence[str]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return handler.generate_schema(Literal[tuple(self.names)])


class EachOnce:
    """Marks a tuple whose items differ."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return AfterValidator(_refuse_repeats).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(
        self, schema: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {**handler(schema), "uniqueItems": True}


def _refuse_repeats(items: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(items)) < len(items):
        raise ValueError("items repeat")
    return items
