"""Settings refuse what is out of range, complete what is given in part, and tell their schema."""

from typing import Annotated, Literal

import pytest

from drapeline.errors import InputError
from drapeline.settings import EachOnce, Field, OneOf, Settings, Share, SkipJsonSchema


class Network(Settings):
    """Sizes.

    Of a toy.
    """

    widths: tuple[Annotated[int, Field(ge=1, le=9)], ...] = Field(
        (4, 8), min_length=2, description="Features."
    )
    rate: float = Field(1, gt=0, le=3, description="Rate.")
    form: Literal["paper", "released"] = Field("paper", description="Form.")
    most: Annotated[int, Field(ge=2)] | None = Field(None, description="Most.")
    seed: SkipJsonSchema[int] = Field(0, description="Seed.")


class Wearing(Settings):
    """How it is worn."""

    file: str = Field(description="the OBJ file")


class Toy(Settings):
    """A model."""

    network: Network = Network(rate=2)
    share: Share = Field(0.5, description="Share.")
    fabric: Annotated[str, OneOf(("silk", "denim"))] = Field("silk", description="Fabric.")
    kinds: Annotated[tuple[str, ...], EachOnce()] = Field(("a",), description="Kinds.")
    files: dict[Annotated[str, OneOf(("Top", "Skirt"))], str] = Field({}, description="Files.")
    devices: Literal["auto"] | Annotated[int, Field(ge=1)] = Field(1, description="Devices.")


def test_groups_given_in_part_have_the_rest_of_their_place():
    assert Toy(network={"widths": [1, 2]}).network == Network(widths=(1, 2), rate=2)
    assert Toy(network=Network()).network.rate == 1
    changed = Toy(network={"widths": [1, 2]}).replace(network={"seed": 3}, share=0)
    assert changed.network == Network(widths=(1, 2), rate=2, seed=3)
    assert changed.share == 0


def test_plain_values_make_the_same_settings_again():
    settings = Toy(network={"widths": [3, 3]}, files={"Top": "a.obj"}, devices="auto")
    plain = settings.plain()
    assert plain["network"]["widths"] == [3, 3]
    assert Toy(**plain) == settings == Toy.model_validate(plain)


def test_settings_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        Toy().share = 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shere": 1}, r"^Toy: 'shere' is not a setting, did you mean share\? expected one of dev"),
        ({"share": 2}, r"^Toy: share is 2, expected a number from 0 to 1 \(Share\)$"),
        ({"share": "1"}, r"^Toy: share is '1', expected a number from 0 to 1"),
        ({"share": True}, r"^Toy: share is True, expected a number from 0 to 1"),
        ({"share": float("nan")}, r"^Toy: share is nan, expected a number from 0 to 1"),
        ({"network": {"rate": 0}}, r"^Network: rate is 0, expected a number above 0 and at most 3"),
        ({"network": {"form": "own"}}, r"^Network: form is 'own', expected one of paper, released"),
        ({"network": {"widths": [1, 10]}}, r"^Network: widths.1 is 10, expected an integer from 1"),
        (
            {"network": {"widths": [1]}},
            r"^Network: widths is \(1,\), expected an array of 2",
        ),
        (
            {"network": {"most": 1}},
            r"^Network: most is 1, expected an integer of at least 2 or null",
        ),
        ({"network": {"seed": "x"}}, r"^Network: seed is 'x', expected .* integer"),
        ({"network": 3}, r"^Toy: network is 3, expected an object"),
        ({"fabric": "tin"}, r"^Toy: fabric is 'tin', expected one of silk, denim$"),
        ({"kinds": ["a", "a"]}, r"^Toy: kinds is \('a', 'a'\), expected an array, each named once"),
        ({"files": {"Hat": "a"}}, r"^Toy: files is \{'Hat': 'a'\}, expected an object \(Files\)"),
        ({"files": {"Top": 3}}, r"^Toy: files.Top is 3, expected a string"),
        ({"devices": 0}, r"^Toy: devices is 0, expected one of auto or an integer of at least 1"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(given, message):
    with pytest.raises(InputError, match=message):
        Toy(**given)


def test_a_value_without_a_default_must_be_given():
    with pytest.raises(InputError, match="^Wearing: file is missing, expected the OBJ file$"):
        Wearing()


def test_schemas_are_closed_and_plain_with_the_defaults_of_each_place():
    assert Toy.schema_of_config() == {
        "title": "Toy",
        "type": "object",
        "additionalProperties": False,
        "description": "A model.",
        "properties": {
            "network": {
                "type": "object",
                "additionalProperties": False,
                "default": {},
                "description": "Sizes.",
                "properties": {
                    "widths": {
                        "type": "array",
                        "minItems": 2,
                        "items": {"type": "integer", "minimum": 1, "maximum": 9},
                        "default": [4, 8],
                        "description": "Features.",
                    },
                    "rate": {
                        "type": "number",
                        "exclusiveMinimum": 0,
                        "maximum": 3,
                        "default": 2.0,
                        "description": "Rate.",
                    },
                    "form": {
                        "type": "string",
                        "enum": ["paper", "released"],
                        "default": "paper",
                        "description": "Form.",
                    },
                    "most": {
                        "type": ["integer", "null"],
                        "minimum": 2,
                        "default": None,
                        "description": "Most.",
                    },
                },
            },
            "share": {
                "type": "number",
                "minimum": 0,
                "maximum": 1,
                "default": 0.5,
                "description": "Share.",
            },
            "fabric": {
                "type": "string",
                "enum": ["silk", "denim"],
                "default": "silk",
                "description": "Fabric.",
            },
            "kinds": {
                "type": "array",
                "uniqueItems": True,
                "items": {"type": "string"},
                "default": ["a"],
                "description": "Kinds.",
            },
            "files": {
                "type": "object",
                "additionalProperties": False,
                "default": {},
                "description": "Files.",
                "properties": {"Top": {"type": "string"}, "Skirt": {"type": "string"}},
            },
            "devices": {
                "anyOf": [
                    {"type": "string", "enum": ["auto"]},
                    {"type": "integer", "minimum": 1},
                ],
                "default": 1,
                "description": "Devices.",
            },
        },
    }
