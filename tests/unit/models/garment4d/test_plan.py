"""What an experiment does with Garment4D, without Snakemake."""

import pytest
import yaml

from drapeline.models.garment4d.plan import MODEL
from drapeline.models.garment4d.settings import MGN_VARIANTS, POSED_VARIANTS
from toys.paper import PAPER
from toys.plans import files_of
from toys.snakemake_run import ROOT

TINY = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())
TYPES = ("Skirt", "Trousers")


@pytest.fixture(scope="module")
def plan():
    return MODEL.plan(files_of({**TINY, "garment4d": {"garments": [*TYPES]}}))


def folders(files):
    """Folders beneath that of Garment4D."""
    return [file.rpartition("/garment4d/")[2] for file in files]


def test_labels_are_trained_once_with_the_clouds_of_all_types(plan):
    task = plan.trainings["labels"]
    assert task.run == "drapeline.models.garment4d.ours.train:train_labels"
    assert folders(task.input["data"]) == [f"{garment}/data_surface" for garment in TYPES]
    assert task.params["settings"]["network"]["points"] > 0
    assert len(task.checks) == len(TYPES)
    for check in task.checks:
        check()


@pytest.mark.parametrize("garment", TYPES)
def test_our_model_is_fitted_with_labels_and_without_the_paper_s_networks(plan, garment):
    task = plan.trainings[f"{garment}/ours"]
    given = [file for name, file in task.input.items() if name not in ("female", "male")]
    assert folders(given) == [f"{garment}/data_surface", "labels"]


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
