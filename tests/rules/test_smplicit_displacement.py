"""The rules of SMPLicit's displacements, from samples to page, on toy skirts."""

import pytest

from drapeline.bodies.model import save_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.pose_displacements import DisplacementData
from drapeline.metrics.table import read_metrics
from drapeline.models.load import load
from drapeline.storage import save_npz
from toys.displacement import CLUSTERS, write_moving_skirts

SETTINGS = {
    "network": {"code": 3, "width": 0.1},
    "loss": {},
    "training": {"epochs": 2, "batch": 4, "edges": 8},
}

pytestmark = pytest.mark.portable


@pytest.fixture(scope="module")
def made(tmp_path_factory, run_rule, toy_body):
    """Every rule of them."""
    folder = tmp_path_factory.mktemp("displacement_rules")
    for gender in GENDERS:
        save_body(folder / f"{gender}.npz", toy_body)
    bodies = {gender: folder / f"{gender}.npz" for gender in GENDERS}
    samples = [tiny.folder for tiny in write_moving_skirts(folder, toy_body)]
    save_npz(folder / "fields" / "clusters.npz", vertices=CLUSTERS)
    run_rule(
        "collect_displacements",
        input={**bodies, "samples": samples, "learning": []},
        output=[folder / "data"],
        params={"garments": ("Skirt",), "frame_step": 2},
    )
    run_rule(
        "train_displacement",
        input={**bodies, "data": folder / "data", "fields": folder / "fields"},
        output=[folder / "model"],
        params={
            "settings": SETTINGS,
            "trainer": {"accelerator": "cpu"},
            "progress": str(folder / "progress"),
            "code": "x",
        },
        wildcards={"field": "skirt"},
    )
    run_rule(
        "evaluate_displacement",
        input={
            **bodies,
            "model": folder / "model",
            "data": folder / "data",
            "fields": folder / "fields",
            "samples": samples,
            "learning": [],
        },
        output=[folder / "metrics.tsv"],
        params={"garments": ("Skirt",), "split": "test", "frame_step": 3, "seed": 0},
    )
    return folder


def test_training_and_validation_frames_are_collected(made):
    assert len(DisplacementData(made / "data")) == 3 * 3


def test_held_out_frames_are_evaluated(made):
    rows = read_metrics(made / "metrics.tsv")
    assert set(rows["split"]) == {"test"}
    assert set(rows["n"]) == {2}
    assert "smplicit_displacement_skirt_network" in set(rows["variant"])


def test_the_trained_network_is_loaded(made):
    assert load(made / "model").name == "skirt"


def test_the_page_is_made(made, run_rule, tmp_path):
    run_rule("tabulate_displacement", input=[made / "metrics.tsv"], output=[tmp_path / "page.html"])
    assert "With the network" in (tmp_path / "page.html").read_text()


def test_clusters_that_are_missing_are_named(made, run_rule, tmp_path):
    with pytest.raises((InputError, SystemExit)):
        run_rule(
            "train_displacement",
            input={
                **{gender: made / f"{gender}.npz" for gender in GENDERS},
                "data": made / "data",
                "fields": tmp_path,
            },
            output=[tmp_path / "model"],
            params={"settings": SETTINGS, "trainer": {}, "progress": "", "code": "x"},
            wildcards={"field": "skirt"},
        )
    assert not (tmp_path / "model").exists()
