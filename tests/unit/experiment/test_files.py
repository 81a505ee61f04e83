"""Files of an experiment, and which groups a model learns from."""

import pytest

from drapeline.dataset.settings import SCAN_KINDS
from drapeline.experiment.settings import Scans
from drapeline.models.registry import models as all_models
from drapeline.outfits.garment_types import GARMENT4D_TYPES
from toys.plans import files_of


def test_models_learn_from_all_groups_but_those_that_are_for_others():
    brief = {"count": 4, "solver": "xpbd", "prefix": "B", "learned_by": ["garment4d"]}
    files = files_of({"groups": {"dataset": {"count": 3}, "brief": brief}})
    own = {name: files.learned_by(name) for name in ("gcvae", "garment4d")}
    assert own["garment4d"].groups == files.groups
    assert own["gcvae"].groups.keys() == files.groups.keys() - {"brief"}
    left_out = {*files.moving_plans} - {*own["gcvae"].moving_plans}
    assert left_out == {f"B{number:05d}" for number in range(1, 5)}
    assert own["gcvae"].config == files.config


def test_the_same_samples_are_scanned_in_every_way():
    files = files_of({"groups": {"dataset": {"count": 12}}})
    found = [files.known_scans(kind) for kind in SCAN_KINDS]
    assert found[0]["samples"] == found[1]["samples"] == found[2]["samples"] != []
    every = [path for one in found for path in one["scans"]]
    assert len({*every}) == len(every) == len(SCAN_KINDS) * len(found[0]["scans"])
    assert {*SCAN_KINDS} <= Scans().plain().keys()


def test_all_models_are_asked_about_the_same_samples_which_each_of_them_has():
    others = {"count": 12, "solver": "xpbd"}
    brief = {**others, "prefix": "B", "learned_by": ["garment4d"]}
    files = files_of({"groups": {"dataset": {"count": 12}, "learning": others, "brief": brief}})
    assert any(plan.split == "test" for plan in files.groups["brief"].plans)
    assert [group.name for group in files.shared] == ["dataset", "learning"]
    assert {files.places[name]["group"] for name in files.scanned} == {"dataset", "learning"}
    for model in all_models():
        own = files.learned_by(model)
        assert own.scanned == files.scanned
        for kind in SCAN_KINDS:
            assert own.known_scans(kind) == files.known_scans(kind)


@pytest.mark.parametrize(
    ("models", "compared"),
    [
        (["skirt", "trousers", "upper", "whole"], GARMENT4D_TYPES),
        (["whole", "upper"], ["Tshirt"]),
        (["trousers", "skirt"], ["Skirt", "Trousers"]),
        (["whole"], GARMENT4D_TYPES),  # rather than on none
    ],
)
def test_models_are_compared_on_garments_that_each_of_them_learns(models, compared):
    files = files_of({"smplicit": {"models": models}, "seed": 3, "model_seed": 5})
    assert files.compared_garments == [*compared]
    assert files.compared == {"garments": [*compared], "split": "test", "seed": 5}
    few = files_of({"smplicit": {"models": models}, "garment4d": {"garments": ["Trousers"]}})
    assert few.compared_garments == ["Trousers"]
