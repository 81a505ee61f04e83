"""What an experiment does with Garment4D, without Snakemake."""

import pytest
import yaml

from drapeline.errors import InputError
from drapeline.models.garment4d.plan import MODEL
from drapeline.models.garment4d.settings import MGN_VARIANTS, POSED_VARIANTS
from drapeline.outfits.garment_types import GARMENTS
from toys.paper import PAPER
from toys.plans import files_of
from toys.snakemake_run import ROOT

TINY = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())
TYPES = ("Skirt", "Trousers")


@pytest.fixture(scope="module")
def files():
    return files_of({**TINY, "garment4d": {"garments": [*TYPES]}})


@pytest.fixture(scope="module")
def plan(files):
    return MODEL.plan(files)


def folders(files):
    """Folders beneath that of Garment4D."""
    return [file.rpartition("/garment4d/")[2] for file in files]


def test_labels_are_trained_once_with_the_clouds_of_all_that_is_worn(plan):
    task = plan.trainings["labels"]
    assert task.run == "drapeline.models.garment4d.ours.train:train_labels"
    assert folders([task.input["data"]]) == ["labelled"]
    assert task.params["settings"]["network"]["points"] > 0
    assert len(task.checks) == len(TYPES)
    for check in task.checks:
        check()


def test_the_card_of_the_labels_names_what_is_learned_and_that_of_our_model_its_own(plan, files):
    packages = plan.packages
    plans = (*files.moving_plans.values(), *files.resting_plans.values())
    worn = {name for p in plans if p.split == "train" for name in p.outfit_type.split("+")}
    assert packages["labels"].garments == tuple(name for name in GARMENTS if name in worn)
    for garment in TYPES:
        assert packages[f"garment4d/{garment}"].garments == (garment,)


def test_all_clouds_are_collected_without_a_fit_of_any_template(plan, files):
    given = plan.data["labelled"].input
    samples, clouds = (folders(given[key]) for key in ("samples", "clouds"))
    assert len(samples) == len(clouds) == sum(len(group.shards) for group in files.moving)
    assert {one.partition("/")[0] for one in clouds} == {"clouds_surface"}
    assert folders(given["skinned"]) == [
        f"skinned/{group.name}/{shard}" for group in files.resting for shard in group.shards
    ]
    assert given.keys() == {"samples", "clouds", "skinned", "female", "male"}


@pytest.mark.parametrize("garment", GARMENTS)
def test_sequences_of_a_type_need_its_own_template_where_it_is_worn(plan, files, garment):
    for protocol in ("surface", "vertices"):
        given = plan.data[f"{garment}/data_{protocol}"].input
        assert folders([given["template"]]) == [f"{garment}/template.npz"]
        fits = folders(given["fits"])
        assert all(one.startswith(f"{garment}/fits/") for one in fits)
        worn = {
            f"{garment}/fits/{group.name}/{shard}"
            for group in files.groups.values()
            for shard, plans in group.shards.items()
            if any(garment in planned.outfit_type.split("+") for planned in plans)
        }
        assert sorted(fits) == sorted(worn)
        assert len(given["samples"]) == len(given["clouds"])
        assert len(given["skinned"]) == len(given["outfits"])
        # Clouds of outfits at rest follow the config's protocol.
        assert len(given["skinned"]) + len(given["samples"]) == len(
            [one for one in fits if protocol == "surface" or "/static/" not in one]
        )


def test_our_model_can_learn_every_type_and_the_paper_s_networks_those_compared(plan):
    learning = {name.partition("/")[0] for name in plan.trainings if name.endswith("/ours")}
    assert learning == {*GARMENTS}
    paper_s = {name.partition("/")[0] for name in plan.trainings if name.endswith("/canonical")}
    assert paper_s == {*TYPES}
    for name in (*TYPES, "Dress", "Top"):
        for check in plan.trainings[f"{name}/ours"].checks:
            check()
    for check in plan.trainings["Jacket/ours"].checks:
        with pytest.raises(InputError, match="the plan has 0 sequences of a Jacket for train"):
            check()


@pytest.mark.parametrize("garment", [*TYPES, "Dress"])
def test_our_model_is_fitted_with_labels_and_without_the_paper_s_networks(plan, garment):
    task = plan.trainings[f"{garment}/ours"]
    given = [file for name, file in task.input.items() if name not in ("female", "male")]
    assert folders(given) == [f"{garment}/data_surface", "labelled", "labels"]


@pytest.mark.parametrize("garment", TYPES)
def test_the_paper_s_networks_are_trained_without_ours(plan, garment):
    for name in ("canonical", "pointnet", *MGN_VARIANTS, *POSED_VARIANTS):
        task = plan.trainings[f"{garment}/{name}"]
        given = [file for key, file in task.input.items() if key not in ("female", "male")]
        expected = [f"{garment}/data_surface"]
        if name not in ("canonical", "pointnet"):
            expected.append(f"{garment}/canonical")
        assert folders(given) == expected


def test_both_are_evaluated_and_fitted_to_scans(plan):
    for garment in TYPES:
        for name in (garment, f"{garment}_ablations"):
            given = plan.evaluations[f"evaluated/{name}"].task.input
            assert folders([given["ours"]]) == [f"{garment}/ours"]
            assert f"{garment}/posed" in folders(given["posed"])
    given = plan.evaluations["evaluated/scans"].task.input
    assert folders(given["ours"]) == [f"{garment}/ours" for garment in TYPES]
    assert folders(given["networks"]) == [f"{garment}/posed" for garment in TYPES]


def test_what_is_compared_at_rest_is_registered_to_the_template_of_its_type(plan, files):
    given = plan.evaluations["evaluated/representations"].task.input
    for garment in TYPES:
        assert folders([given[garment]]) == [f"{garment}/data_surface"]
        assert folders(given[f"fits_{garment}"]) == [
            f"{garment}/fits/{group.name}/{shard}"
            for group in files.resting
            for shard in group.shards
        ]
    told = folders(plan.figures["tabulate_garment4d"].task.input["fits"])
    assert {fits.partition("/")[0] for fits in told} == {*TYPES}


def departures(config):
    """Of an experiment's networks from the paper's, as its pages tell."""
    plan = MODEL.plan(files_of(config))
    return plan.figures["tabulate_garment4d"].task.params["departures"]


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"canonical": {"loss": {"balance": 0.5}}}, "balance"),
        ({"posed": {"network": {"pull_neighbours": 4}}}, "pull_neighbours"),
        ({"posed": {"network": {"smooth_passes": 8}}}, "smooth_passes"),
    ],
)
def test_departures_from_the_paper_are_those_of_its_networks(changed, told):
    paper = yaml.safe_load(PAPER.read_text())
    assert departures(paper) == []
    assert departures({**paper, "garment4d": {**paper["garment4d"], **changed}}).count(told) == 1
