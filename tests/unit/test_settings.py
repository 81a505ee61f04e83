import pytest
import yaml

from drapeline.errors import InputError
from drapeline.settings import checked_settings

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
    assert checked_settings(given, SCHEMA, "x.yaml") == {
        "seed": 1,
        "cloth": {"gap_m": 0.004, "kind": "denim"},
    }
    assert given == {"cloth": {"kind": "denim"}}


def test_defaults_of_two_calls_are_independent():
    first = checked_settings({}, SCHEMA, "x.yaml")
    first["cloth"]["gap_m"] = 99
    assert checked_settings({}, SCHEMA, "x.yaml")["cloth"]["gap_m"] == 0.004


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sede": 3}, r"x.yaml: 'sede' is not a setting, expected one of cloth, seed"),
        ({"cloth": {"gap": 1}}, r"x.yaml: 'cloth.gap' is not a setting, expected one of gap_m"),
        ({"seed": -1}, r"x.yaml: seed is -1, expected an integer of at least 0"),
        ({"seed": "1"}, r"x.yaml: seed is '1', expected an integer"),
        ({"cloth": {"gap_m": 4}}, r"cloth.gap_m is 4, expected a number from 0.001 to 0.03"),
        ({"cloth": {"kind": "wool"}}, r"cloth.kind is 'wool', expected one of silk, denim"),
        ({"cloth": None}, r"cloth is None, expected an object"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(given, message):
    with pytest.raises(InputError, match=message):
        checked_settings(given, SCHEMA, "x.yaml")
