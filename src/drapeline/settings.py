"""Settings: one declaration of type, default, range and meaning, for configs, Python and files.

    class Loss(Settings):
        '''Weights of the loss.'''

        mask: float = Field(0.5, ge=0, le=10_000, description="Weight of the mask.")

Rooms declare theirs in a module `settings`, which is quick to import. `experiment.settings` puts
them together to the whole config, whose schema and page of the documentation come from them. A
field with `SkipJsonSchema` is no key of a config: it is told by rules and written to checkpoints.
"""

from collections.abc import Mapping, Sequence
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
from drapeline.setting_schema import expectation, plain_schema, unknown_setting

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
    schema, path, value = cls.schema_of_config(), [], values
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
