from pathlib import Path

import pytest
import yaml

from drapeline.errors import InputError
from drapeline.experiment.config import fill_settings
from drapeline.storage import check_name

SCHEMA = yaml.safe_load(
    """
type: object
additionalProperties: false
properties:
  seed: {type: integer, minimum: 0, default: 1}
  cloth:
    type: object
    additionalProperties: false
    default: {}
    properties:
      gap_m: {type: number, minimum: 0.001, maximum: 0.03, default: 0.004}
      kind: {enum: [silk, denim], default: silk}
"""
)


def test_defaults_are_filled_at_every_level_and_given_values_kept():
    given = {"cloth": {"kind": "denim"}}
    assert fill_settings(given, SCHEMA, "x.yaml") == {
        "seed": 1,
        "cloth": {"gap_m": 0.004, "kind": "denim"},
    }
    assert given == {"cloth": {"kind": "denim"}}


def test_parts_that_are_one_object_in_yaml_get_defaults_of_their_own():
    schema = {
        "properties": {
            name: {"properties": {"epochs": {"default": epochs}}}
            for name, epochs in (("first", 1), ("second", 2))
        }
    }
    given = yaml.safe_load("{first: &same {batch: 4}, second: *same}")
    assert fill_settings(given, schema, "x.yaml") == {
        "first": {"batch": 4, "epochs": 1},
        "second": {"batch": 4, "epochs": 2},
    }


def test_defaults_of_two_calls_are_independent():
    first = fill_settings({}, SCHEMA, "x.yaml")
    first["cloth"]["gap_m"] = 99
    assert fill_settings({}, SCHEMA, "x.yaml")["cloth"]["gap_m"] == 0.004


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"sede": 3},
            r"x.yaml: 'sede' is not a setting, did you mean seed\? expected one of cloth, seed$",
        ),
        ({"tail": 3}, r"x.yaml: 'tail' is not a setting, expected one of cloth, seed$"),
        ({"cloth": {"gap": 1}}, r"x.yaml: 'cloth.gap' is not a setting, did you mean gap_m\? exp"),
        ({"seed": -1}, r"x.yaml: seed is -1, expected an integer of at least 0"),
        ({"seed": "1"}, r"x.yaml: seed is '1', expected an integer"),
        ({"cloth": {"gap_m": 4}}, r"cloth.gap_m is 4, expected a number from 0.001 to 0.03"),
        ({"cloth": {"kind": "wool"}}, r"cloth.kind is 'wool', expected one of silk, denim"),
        ({"cloth": None}, r"cloth is None, expected an object"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(given, message):
    with pytest.raises(InputError, match=message):
        fill_settings(given, SCHEMA, "x.yaml")


FORMS = yaml.safe_load(
    """
type: object
additionalProperties: false
properties:
  rate: {type: number, exclusiveMinimum: 0, maximum: 1, default: 0.5}
  weight: {type: number, exclusiveMinimum: 0, default: 1}
  share: {type: number, maximum: 0.5, default: 0}
  widths: {type: array, minItems: 2, maxItems: 2, default: [1, 2]}
  names: {type: array, minItems: 1, maxItems: 3, uniqueItems: true, default: [a]}
  kinds: {type: array, maxItems: 3, default: []}
  colours: {type: array, minItems: 1, default: [red]}
  parts: {type: array, items: {enum: [body, cloth]}, uniqueItems: true, default: [body]}
  count: {type: [integer, "null"], minimum: 1, default: null}
  devices:
    type: [integer, string]
    anyOf: [{enum: [auto, -1]}, {type: integer, minimum: 1}]
    default: auto
    description: How many.
  files:
    type: object
    additionalProperties: false
    default: {}
    properties: {female: {type: string}, male: {type: string}}
    dependentRequired: {female: [male], male: [female]}
"""
)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate": 2}, r"rate is 2, expected a number above 0 and at most 1$"),
        ({"rate": 0}, r"rate is 0, expected a number above 0 and at most 1$"),
        ({"weight": 0}, r"weight is 0, expected a number above 0$"),
        ({"share": 0.7}, r"share is 0.7, expected a number of at most 0.5$"),
        ({"widths": [1, 2, 3]}, r"is \[1, 2, 3\], expected an array of exactly 2 items$"),
        ({"names": []}, r"expected an array of 1 to 3 items, each named once$"),
        ({"kinds": [1, 2, 3, 4]}, r"expected an array of at most 3 items$"),
        ({"colours": []}, r"expected an array of 1 or more items$"),
        ({"parts": ["hat"]}, r"parts.0 is 'hat', expected one of body, cloth$"),
        ({"parts": "hat"}, r"'hat', expected an array out of body, cloth, each named once$"),
        ({"count": 0}, r"count is 0, expected an integer of at least 1 or null$"),
        ({"files": {"male": "a"}}, r"x.yaml: files names male but no female, expected both$"),
        ({"files": {"female": "a"}}, r"x.yaml: files names female but no male, expected both$"),
    ],
)
def test_every_bound_is_told(given, message):
    with pytest.raises(InputError, match=message):
        fill_settings(given, FORMS, "x.yaml")


@pytest.mark.parametrize("devices", ["auto", -1, 1, 8])
def test_a_value_may_have_one_of_several_forms(devices):
    assert fill_settings({"devices": devices}, FORMS, "x.yaml")["devices"] == devices


@pytest.mark.parametrize("devices", ["two", 0, -2, True, 1.5])
def test_a_value_of_none_of_the_forms_is_told_all(devices):
    expected = (
        rf"devices is {devices!r}, expected one of auto, -1 or an integer of at least 1 \(How"
    )
    with pytest.raises(InputError, match=expected):
        fill_settings({"devices": devices}, FORMS, "x.yaml")


def test_whole_numbers_may_be_written_with_a_point():
    filled = fill_settings({"seed": 3.0, "cloth": {"gap_m": 0.01}}, SCHEMA, "x.yaml")
    assert filled["seed"] == 3
    assert isinstance(filled["seed"], int)
    with pytest.raises(InputError, match=r"x\.yaml: seed is 3.5, expected an integer"):
        fill_settings({"seed": 3.5}, SCHEMA, "x.yaml")


@pytest.mark.parametrize("word", [".nan", ".inf", "-.inf"])
def test_numbers_must_be_finite(word):
    given = yaml.safe_load(f"cloth: {{gap_m: {word}}}")
    with pytest.raises(InputError, match=r"x\.yaml: cloth\.gap_m is .*, expected a finite number"):
        fill_settings(given, SCHEMA, "x.yaml")


def test_unknown_keys_of_any_type_are_named():
    with pytest.raises(InputError, match="x.yaml: '1' is not a setting"):
        fill_settings({1: 2, "tail": 3, None: 4}, SCHEMA, "x.yaml")


def test_aliases_of_aliases_are_refused_before_they_are_printed():
    lines = ["a0: &a0 [x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    given = yaml.safe_load("\n".join([*lines, "seed: *a11"]))
    with pytest.raises(InputError, match="expected fewer aliases"):
        fill_settings(given, SCHEMA, "x.yaml")


@pytest.mark.parametrize(
    "name", ["walk", "take.1", "2-b_c", ".hidden", "a b", "../evil", "x" * 101]
)
def test_sequences_of_a_config_are_called_as_those_of_a_table(name):
    path = Path(__file__).parents[3] / "workflow/schemas/config.schema.yaml"
    schema = yaml.safe_load(path.read_text())
    try:
        check_name(name, "a name")
    except InputError:
        with pytest.raises(InputError, match="sequences"):
            fill_settings({"motions": {"sequences": [name]}}, schema, "x.yaml")
    else:
        filled = fill_settings({"motions": {"sequences": [name]}}, schema, "x.yaml")
        assert filled["motions"]["sequences"] == [name]
