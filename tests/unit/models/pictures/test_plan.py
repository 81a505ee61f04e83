import pytest
import yaml

from drapeline.models.pictures.plan import pictured_samples
from drapeline.models.registry import models as all_models
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from toys.plans import files_of
from toys.snakemake_run import ROOT

TINY = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())


@pytest.mark.parametrize("models", [["skirt"], ["skirt", "trousers", "upper", "whole"]])
def test_pictures_are_of_held_out_samples_that_wear_something_known(models):
    config = {**TINY, "smplicit": {**TINY["smplicit"], "models": models}}
    files = files_of(config)
    told = pictured_samples(files)
    chosen = told["samples"] + told["others"]
    assert chosen
    for sample in chosen:
        plan = files.moving_plans[sample]
        assert plan.split == told["split"] == "test"
        assert any(MODEL_OF_GARMENT[name] in models for name in plan.outfit_type.split("+"))
    published = {plan.sample for group in files.published for plan in group.plans}
    assert published >= set(told["samples"])
    assert published.isdisjoint(told["others"])


def test_all_models_see_the_same_pictures_of_samples_that_each_of_them_has():
    own = {"published": True, "solver": "xpbd", "learned_by": ["garment4d"]}
    others = {"count": 12, "solver": "xpbd"}
    groups = {
        "dataset": {"count": 12},
        "learning": {"count": 12},
        "own": {**own, "count": 12, "prefix": "A"},
        "brief": {**others, "prefix": "B", "learned_by": ["garment4d"]},
    }
    files = files_of({"groups": groups})
    told = pictured_samples(files)
    assert {files.places[name]["group"] for name in told["samples"]} == {"dataset"}
    assert {files.places[name]["group"] for name in told["others"]} == {"learning"}
    for name in ("own", "brief"):
        assert any(plan.split == "test" for plan in files.groups[name].plans)
    for model in all_models():
        assert pictured_samples(files.learned_by(model)) == told


def test_another_seed_of_trainings_changes_no_picture():
    seed = TINY["seed"]
    first, again, other = (
        pictured_samples(files_of({**TINY, **own}))
        for own in ({}, {"model_seed": seed + 1}, {"seed": seed + 1})
    )
    assert first == again
    assert (first["picture_seed"], other["picture_seed"]) == (seed, seed + 1)
