"""The schema is closed and complete, and the shipped configs fit it."""

from pathlib import Path

import pytest
import yaml

from drapeline.experiment.config import fill_settings
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.garment_types import CLOTH3D_OUTFITS, GARMENT4D_TYPES, GARMENTS, OUTFIT_TYPES
from drapeline.outfits.settings import OPENINGS
from drapeline.registration.to_template.garment_template import LOOP_NAMES
from toys.schema import SCHEMA

ROOT = Path(__file__).parents[2]


def objects(schema):
    if schema.get("type") == "object":
        yield schema
        for part in schema["properties"].values():
            yield from objects(part)
        if isinstance(schema["additionalProperties"], dict):  # named by the user
            yield from objects(schema["additionalProperties"])


def test_every_object_is_closed_and_every_key_described_or_an_object():
    for schema in objects(SCHEMA):
        assert schema["additionalProperties"] is False or isinstance(
            schema["additionalProperties"], dict
        )
        for name, part in schema["properties"].items():
            in_mapping = "default" not in part  # keys of a mapping may each be there or not
            assert part.get("type") == "object" or "description" in part or in_mapping, name


@pytest.mark.parametrize("name", ["config.yaml", "workflow/config/reference.yaml"])
def test_an_experiment_names_only_what_makes_it_special(name):
    def differences(given, default):
        return {
            key: differences(value, default.get(key, {})) if isinstance(value, dict) else value
            for key, value in given.items()
            if value != default.get(key)
        }

    given = yaml.safe_load((ROOT / name).read_text())
    assert differences(given, fill_settings({}, SCHEMA, "")) == given


@pytest.mark.parametrize(
    "path",
    [*ROOT.glob("*.yaml"), *ROOT.glob("workflow/config/*.yaml"), *ROOT.glob("tests/data/*.yaml")],
    ids=lambda path: path.name,
)
def test_shipped_configs_fit(path):
    fill_settings(yaml.safe_load(path.read_text()), SCHEMA, path.name)


def test_every_garment_type_and_outfit_can_be_asked_for():
    outfits, gcvae, garment4d = (
        SCHEMA["properties"][name]["properties"] for name in ("outfits", "gcvae", "garment4d")
    )
    assert outfits["types"]["items"]["enum"] == [*OUTFIT_TYPES]
    assert outfits["types"]["default"] == [*CLOTH3D_OUTFITS]
    assert list(outfits["own_garments"]["properties"]) == [*GARMENTS]
    for worn in outfits["own_garments"]["properties"].values():
        assert worn["properties"]["fabric"]["enum"] == [*FABRICS, None]
        for key in ("elastic", "held"):
            assert tuple(worn["properties"][key]["items"]["enum"]) == OPENINGS
    sampled = gcvae["sampling"]["properties"]["garments"]["items"]["enum"]
    assert sampled == ["prior", *GARMENTS]
    files = garment4d["template"]["properties"]["files"]["properties"]
    assert list(files) == garment4d["reconstruct"]["properties"]["garment"]["enum"]
    compared = garment4d["garments"]
    assert list(files) == compared["items"]["enum"] == [*GARMENTS]
    assert compared["default"] == [*GARMENT4D_TYPES]
    assert {*LOOP_NAMES} == {*GARMENTS}
