"""What an experiment does with the garment VAEs, without Snakemake."""

import pytest
import yaml

from drapeline.errors import InputError
from drapeline.models.gcvae.plan import MODEL
from drapeline.models.smplicit.plan import MODEL as SMPLICIT
from toys.plans import files_of
from toys.snakemake_run import ROOT

TINY = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())


def animated(**asked):
    """The task that sets sampled outfits in motion."""
    gcvae = {**TINY.get("gcvae", {}), "animation": asked}
    return MODEL.plan(files_of({**TINY, "gcvae": gcvae})).samples["animated"]


def check(task):
    for one in task.checks:
        one()


def test_outfits_are_those_of_the_experiment_on_a_clip_of_its_samples():
    task = animated(count=4)
    check(task)
    plans = task.params["plans"]
    assert len({plan["sample"] for plan in plans}) == 4
    assert len({plan["sequence"] for plan in plans}) == 1
    assert f"/motions/{plans[0]['sequence']}/" in task.input["motion"]
    worn = {plan.outfit_type for plan in files_of(TINY).resting_plans.values()}
    assert {plan["outfit_type"] for plan in plans} <= worn


def test_only_what_moves_the_outfits_is_trained_for_it():
    assert {"dvae", "mlp"} <= animated().input.keys()
    assert not {"dvae", "mlp"} & animated(movers=["solver"]).input.keys()
    assert animated(movers=["ppca"]).input["ppca"].endswith("gcvae/dynamic_ppca")


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"clip": "moonwalk"}, "gcvae.animation.clip: 'moonwalk', expected one of "),
        ({"types": ["Tshirt+Trousers+Jacket"]}, "gcvae.animation.types: Jacket, expected garments"),
    ],
)
def test_what_cannot_be_animated_is_refused_before_anything_runs(asked, sentence):
    with pytest.raises(InputError, match=sentence):
        check(animated(**asked))


def test_a_clip_that_no_sample_moves_through_is_refused():
    groups = {**TINY["groups"], "dataset": {"count": 1}, "learning": {"count": 1}}
    known = TINY["motions"]["sequences"]
    idle = [clip for clip in known if clip not in _moved({**TINY, "groups": groups})]
    gcvae = {**TINY.get("gcvae", {}), "animation": {"clip": idle[0]}}
    plan = MODEL.plan(files_of({**TINY, "groups": groups, "gcvae": gcvae}))
    with pytest.raises(InputError, match=f"gcvae.animation.clip: '{idle[0]}', expected one of"):
        check(plan.samples["animated"])


def _moved(config):
    return {plan.sequence for plan in files_of(config).moving_plans.values()}


def test_a_mover_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="wind"):
        animated(movers=["wind"])


def test_pictures_are_those_that_smplicit_is_evaluated_on():
    files = files_of(TINY)
    own = MODEL.plan(files).evaluations["evaluated/pictures"].task
    theirs = SMPLICIT.plan(files).evaluations["evaluated/images"].task
    for name in ("split", "samples", "pictures", "others", "size_px", "seed", "picture_seed"):
        assert own.params[name] == theirs.params[name]
    assert own.input["samples"] == theirs.input["samples"]


def test_comparisons_with_other_models_are_of_garments_that_all_of_them_know():
    files = files_of({**TINY, "smplicit": {**TINY["smplicit"], "models": ["skirt"]}})
    evaluations = MODEL.plan(files).evaluations
    for name in ("representations", "other_codes", "moved_again"):
        params = evaluations[f"evaluated/{name}"].task.params
        assert {key: params[key] for key in files.compared} == files.compared
        assert params["garments"] == ["Skirt"]


def test_the_network_learns_the_codes_that_are_shown():
    gcvae = {**TINY["gcvae"], "sampling": {"variant": "svae"}}
    plan = MODEL.plan(files_of({**TINY, "gcvae": gcvae}))
    tasks = (plan.trainings["pictures"], plan.evaluations["evaluated/pictures"].task)
    assert all(task.input["model"].endswith("gcvae/svae") for task in tasks)
