"""The rules of SMPLicit, from outfits to figure, on toy skirts."""

import pytest
from PIL import Image

from drapeline.bodies.model import save_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import FieldData
from drapeline.metrics.cost import read_costs
from drapeline.metrics.table import read_metrics
from drapeline.models.smplicit.representation import load_held_out
from drapeline.models.start import AT_RANDOM
from toys.outfits_at_rest import save_static
from toys.smplicit import BOXES, toy_outfits

SETTINGS = {
    "network": {"cut": 2, "style": 3, "width": 0.1, "encoder_width": 2},
    "loss": {},
    "training": {"epochs": 2, "batch": 2, "near": 16, "space": 16},
}
MESHING = {"cell_m": 0.04, "threshold_m": 0.028}

pytestmark = pytest.mark.portable


@pytest.fixture(scope="module")
def folder(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("smplicit_rules")
    for gender in GENDERS:
        save_body(folder / f"{gender}.npz", toy_body)
    save_static(folder / "outfits_at_rest", toy_outfits())
    return folder


@pytest.fixture(scope="module")
def made(folder, run_rule):
    """Every rule up to the evaluation."""
    bodies = {gender: folder / f"{gender}.npz" for gender in GENDERS}
    run_rule(
        "sample_fields",
        input={**bodies, "outfits": folder / "outfits_at_rest"},
        output=[folder / "fields.npz"],
        params={"seed": 0, "near": 64, "space": 64, "resolution": 32, "boxes": BOXES},
    )
    run_rule(
        "drapeline.learning_data.garment_fields:collect",
        input={**bodies, "shards": [folder / "fields.npz"]},
        output=[folder / "data"],
        params={"garments": ("Skirt",), "resolution": 32, "clusters": 12},
    )
    run_rule(
        "drapeline.models.smplicit.train:train",
        input={**bodies, "data": folder / "data"},
        output=[folder / "model"],
        params={
            "name": "skirt",
            "settings": SETTINGS,
            "trainer": {"accelerator": "cpu"},
            "start": AT_RANDOM,
            "progress": str(folder / "progress"),
            "code": "x",
        },
    )
    run_rule(
        "drapeline.models.smplicit.evaluate:evaluate",
        input={
            "model": folder / "model",
            "data": folder / "data",
            "outfits": [folder / "outfits_at_rest"],
        },
        output=[folder / "evaluated"],
        params={
            "split": "test",
            "meshing": MESHING,
            "fit": {"steps": 5, "near": 16, "space": 16},
            "seed": 0,
        },
    )
    return folder


def test_fields_are_collected(made):
    assert len(FieldData(made / "data")) == 8


def test_held_out_garments_are_evaluated(made):
    rows = read_metrics(made / "evaluated/metrics.tsv")
    assert set(rows["model"]) == {"smplicit"}
    assert "smplicit_skirt_fitted" in set(rows["variant"])
    assert list(load_held_out(made / "evaluated/held_out.npz")) == [
        ("s6", "Skirt"),
        ("s7", "Skirt"),
    ]
    (cost,) = read_costs([made / "evaluated"]).itertuples()
    assert (cost.model, cost.variant, cost.garments) == ("representation", "skirt", 2)


def test_pages_and_figures_are_made(made, run_rule, tmp_path):
    run_rule(
        "drapeline.report.models.smplicit.tables:tabulate",
        input={"metrics": made / "evaluated/metrics.tsv"},
        output=[tmp_path / "page.html"],
    )
    assert "Skirts" in (tmp_path / "page.html").read_text()
    run_rule(
        "drapeline.models.smplicit.figures:plot_held_out",
        input={
            "models": [made / "model"],
            "data": [made / "data"],
            "evaluated": [made / "evaluated"],
            "outfits": [made / "outfits_at_rest"],
        },
        output=[tmp_path / "garments.png"],
        params={"meshing": MESHING, "rays": 0.01},
    )
    assert Image.open(tmp_path / "garments.png").size[0] > 1000


def test_a_model_that_is_missing_is_named(made, run_rule, tmp_path):
    with pytest.raises((InputError, SystemExit)):
        run_rule(
            "drapeline.models.smplicit.evaluate:evaluate",
            input={
                "model": tmp_path / "nowhere",
                "data": made / "data",
                "outfits": [made / "outfits_at_rest"],
            },
            output=[tmp_path / "m"],
            params={"split": "test", "meshing": MESHING, "fit": {}, "seed": 0},
        )
    assert not (tmp_path / "m").exists()
