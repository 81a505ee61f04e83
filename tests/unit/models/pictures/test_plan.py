import pytest
import yaml

from drapeline.models.pictures.plan import part_of_body, pictured_samples
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from toys.plans import files_of
from toys.snakemake_run import ROOT

TINY = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())


def test_parts_of_the_body_are_those_that_smplicit_has_models_of():
    assert {garment: part_of_body(garment) for garment in MODEL_OF_GARMENT} == MODEL_OF_GARMENT


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
