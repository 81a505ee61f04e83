"""Rules that evaluate static garments, on toy files."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies import smpl_files
from drapeline.bodies.model import save_body
from drapeline.frames import GENDERS
from drapeline.metrics.table import read_metrics
from drapeline.models.gcvae.codec import load_codes
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import save_topology
from toys.gcvae import VERTICES, tube, tube_faces
from toys.gcvae_files import save_model, save_static_data, toy_topology
from toys.metric_rows import find_value

SPLITS = ["val", "test"]


@pytest.fixture
def files(tmp_path):
    garments = save_static_data(tmp_path / "data")
    model = save_model(tmp_path / "model", garments=garments)
    return SimpleNamespace(garments=garments, model=model, folder=tmp_path)


def evaluate(run_rule, files):
    output = files.folder / "evaluated"
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_static",
        input={"model": files.folder / "model", "data": files.folder / "data"},
        output=[output],
        params={"splits": SPLITS, "variant": "svae_no_cvar"},
    )
    return output


def test_evaluate_static_measures_held_out_garments_and_keeps_all_codes(run_rule, files):
    output = evaluate(run_rule, files)
    rows = read_metrics(output / "metrics.tsv")
    assert set(rows["split"]) == set(SPLITS)
    assert {(row.model, row.variant) for row in rows.itertuples()} == {("svae", "svae_no_cvar")}
    whole = find_value(rows, "svae_no_cvar", "test", "all", "surface_error_mm")
    assert whole.n == len(files.garments.rows("test"))
    for name in ("normal_error_deg", "mask_iou", "kl_nat", "inside_share", "pieces"):
        assert find_value(rows, "svae_no_cvar", "val", "all", name) is not None
    codes, about = load_codes(output / "codes.npz")
    assert codes.mean.shape == (len(files.garments.garment), 5)
    np.testing.assert_array_equal(about["split"], files.garments.split)
    np.testing.assert_array_equal(about["garment"], files.garments.garment)


def test_evaluate_baselines_measures_three_and_the_truth(run_rule, files, toy_body, monkeypatch):
    monkeypatch.setattr(smpl_files, "_check_person", lambda *_: None)  # a tube is none
    tube_body = replace(
        toy_body,
        v_template=tube().astype(np.float32),
        faces=tube_faces(False),
        shapedirs=np.zeros((VERTICES, 3, 10), np.float32),
        posedirs=np.zeros((VERTICES, 3, 207), np.float32),
        J_regressor=np.full((24, VERTICES), 1 / VERTICES, np.float32),
        weights=np.eye(24, dtype=np.float32)[np.zeros(VERTICES, int)],
        segmentation=np.zeros(VERTICES, np.int32),
        vt=np.zeros((VERTICES, 2), np.float32),
        ft=tube_faces(False),
    )
    for gender in GENDERS:
        save_body(files.folder / f"{gender}.npz", tube_body)
    save_topology(files.folder / "topology.npz", toy_topology())
    output = files.folder / "baselines"
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_baselines",
        input={
            "data": files.folder / "data",
            "topology": files.folder / "topology.npz",
            **{gender: files.folder / f"{gender}.npz" for gender in GENDERS},
        },
        output=[output],
        params={"splits": SPLITS, "components": 16, "seed": 1},
    )
    rows = read_metrics(output / "metrics.tsv")

    def error(variant, garment="all"):
        return find_value(rows, variant, "test", garment, "surface_error_mm").value

    # Offsets of the toy garments have rank two but for their masks; types tell nothing of them.
    assert error("pca") < 0.7 * error("mean_garment")
    assert error("nearest_cvar") > 0
    assert find_value(rows, "registered", "test", "all", "surface_error_mm") is None
    truth = find_value(rows, "registered", "test", "all", "inside_1cm_share")
    assert (truth.model, truth.value) == ("truth", 0)
    assert {row.garment for row in rows.itertuples() if row.variant == "pca"} >= {
        "all",
        *GARMENTS[:1],
    }


def test_tables_are_collected_and_shown(run_rule, files):
    evaluated = evaluate(run_rule, files)
    whole = files.folder / "metrics.tsv"
    run_rule("collect_metrics", input=[evaluated], output=[whole])
    assert whole.read_bytes() == (evaluated / "metrics.tsv").read_bytes()
    output = {"page": files.folder / "page.html", "table": files.folder / "beside.tsv"}
    run_rule(
        "drapeline.report.models.gcvae.tables:tabulate", input={"metrics": whole}, output=output
    )
    assert "Garment VAE without regressing conditional variables" in output["page"].read_text()
    assert output["table"].read_text().startswith("table\tmodel\tvariant\tgarment\t")


def test_figure_8_and_figure_9_are_drawn(run_rule, files, toy_body):
    evaluated = evaluate(run_rule, files)
    run_rule(
        "drapeline.models.gcvae.figures:plot_evaluated_codes",
        input={"evaluated": evaluated},
        output=[files.folder / "codes.svg"],
    )
    assert ">Dress<" in (files.folder / "codes.svg").read_text()
    for gender in GENDERS:
        save_body(files.folder / f"{gender}.npz", toy_body)
    output = {"sheet": files.folder / "sheet.png", "moving": files.folder / "moving.png"}
    run_rule(
        "drapeline.models.gcvae.figures:plot_walks",
        input={
            "model": files.folder / "model",
            "evaluated": evaluated,
            "data": files.folder / "data",
            **{gender: files.folder / f"{gender}.npz" for gender in GENDERS},
        },
        output=output,
        params={"steps": 2, "frames": 2, "rays": 0.02},
    )
    with Image.open(output["sheet"]) as sheet:
        assert sheet.size[1] > 5 * 250  # shape, tightness, cloth, topology, all
    with Image.open(output["moving"]) as moving:
        assert moving.size == (440, 480)  # of one picture, whether or not the toy garments differ
