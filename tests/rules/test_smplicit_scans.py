"""The rules that scan samples and find garments in scans, on a model whose sheets are tubes."""

import csv

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices, save_body
from drapeline.dataset.segmented_scans import load_scans
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.obj import load_obj
from drapeline.metrics.cost import read_costs
from drapeline.metrics.predictions import BODY, TRUE, load_fitted_scans
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import read_metrics
from drapeline.storage import save_npz
from toys.tiny_sample import write_tiny_sample

BODY_FIT = {"steps": 2, "joint_steps": 2, "points": 200}
FIT = {"cloth": 60, "around": 60, "starts": 2, "steps": 2, "joint_steps": 1}
MESHING = {"cell_m": 0.03, "threshold_m": 0.018}
SIMULATION = {
    "steps_min": 4,
    "steps_max": 4,
    "shape_frames": 1,
    "pose_frames": 2,
    "settle_frames": 0,
}
HANGING = {
    "solver": "drapeline.xpbd.solver",
    "hanging": {"edge_length_m": 0.05, "simulation": SIMULATION},
}
TRANS = np.array([0.2, 0.1, 0.9])


@pytest.fixture
def scanned(run_rule, tmp_path, toy_body):
    """A sample and its scans."""
    sample = write_tiny_sample(tmp_path, toy_body).folder
    save_body(tmp_path / "body.npz", toy_body)
    run_rule(
        "scan_samples",
        input={"samples": sample.parent, **dict.fromkeys(GENDERS, tmp_path / "body.npz")},
        output=[tmp_path / "scans.npz"],
        params={
            "samples": [sample.name],
            "scans": {"frames": 1, "points": 800},
            "body": BODY_FIT,
            "seed": 0,
        },
    )
    return sample, tmp_path / "scans.npz"


@pytest.mark.portable
def test_scans_of_a_sample_have_a_fitted_body(scanned):
    ((scan, body),) = load_scans(scanned[1])
    assert scan.garments == ("Skirt", "Tshirt")
    assert not np.array_equal(body.rotations, scan.estimate.rotations)


@pytest.mark.parametrize(
    ("frames", "kind", "model"),
    [(0, "noisy", "scan"), (2, "noisy", "scan"), (0, "worse", "worse_scan")],
)
def test_held_out_scans_get_garments_rows_and_a_sheet(
    run_rule, scanned, skirt, tmp_path, frames, kind, model
):
    sample, scans = scanned
    run_rule(
        "drapeline.models.smplicit.scans.evaluate:fit_to_scans",
        input={"scans": [scans], "samples": [sample.parent], "models": [skirt]},
        output=[tmp_path / "scans"],
        params={
            "kind": kind,
            "garments": ["Skirt"],
            "split": "test",
            "body": BODY_FIT,
            "fit": FIT | {"hang_frames": frames},
            "meshing": MESHING,
            "seed": 0,
            **HANGING,
        },
    )
    rows = read_metrics(tmp_path / "scans/metrics.tsv")
    assert set(rows["model"]) == {model}
    assert COMMON in set(rows["garment"])
    costs = read_costs([tmp_path / "scans"])
    assert set(costs["model"]) == {model}
    assert set(costs["variant"]) == {name for name in rows["variant"] if "body" not in name}
    assert set(rows["variant"]) == {
        *(f"smplicit_scan_{name}" for name in ("start", "nearest", "code", "joint", "moved")),
        *(f"smplicit_scan_{name}" for name in ("nearest_hung", "hung", "hung_moved") if frames),
        *(f"scan_body_{name}" for name in ("estimated", "fitted", "joint")),
    }
    (shown,) = load_fitted_scans(tmp_path / "scans/fitted_scans.npz").values()
    assert set(shown["smplicit_scan_code"]) == {"Skirt"}
    if frames:
        nearest, hung = (
            shown[f"smplicit_scan_{name}"]["Skirt"] for name in ("nearest", "nearest_hung")
        )
        assert len(hung.vertices) < 0.8 * len(nearest.vertices)
        skinned, hung = (shown[f"smplicit_scan_{name}"]["Skirt"] for name in ("joint", "hung"))
        assert len(hung.vertices) < 0.8 * len(skinned.vertices)
    for name in ("joint", "moved", *(["hung", "hung_moved"] if frames else [])):
        assert set(shown[f"smplicit_scan_{name}"]) == {"Skirt", BODY}
    for before, after in (("joint", "moved"), *([("hung", "hung_moved")] if frames else [])):
        still, moved = (shown[f"smplicit_scan_{name}"]["Skirt"] for name in (before, after))
        assert still.vertices.shape == moved.vertices.shape
        assert not np.allclose(still.vertices, moved.vertices, atol=1e-4)
    assert {TRUE, BODY} <= set(shown)
    evaluated = {
        "noisy": ("tabulate_scans", tmp_path / "scans/metrics.tsv"),
        "worse": ("tabulate_systems", tmp_path / "scans"),
    }
    page, given = evaluated[kind]
    run_rule(page, input=[given], output=[tmp_path / "page.html"])
    assert "SMPLicit, fitted code" in (tmp_path / "page.html").read_text()
    run_rule(
        "plot_scans",
        input={"scans": [scans], "evaluated": [tmp_path / "scans"]},
        output=[tmp_path / "sheet.png"],
        params={"most": 1, "rays": 0.02},
    )
    assert (tmp_path / "sheet.png").stat().st_size > 1000


def write_own(folder, toy_body):
    """A standing body, whose points around the hips are a skirt."""
    points, _ = posed_vertices(toy_body, np.zeros(10), REST_POSE[None], TRANS[None])
    height = points[0, :, 2] - TRANS[2]
    labels = ((height < 0.1) & (height > -0.4)).astype(np.uint8)
    save_npz(folder / "points.npz", points=points, labels=labels[None])
    save_npz(
        folder / "body.npz",
        poses=REST_POSE[None],
        trans=TRANS[None],
        shape=np.zeros(10),
        gender="female",
    )


@pytest.mark.portable
@pytest.mark.parametrize("frames", [0, 2])
def test_a_users_scans_get_their_garments(run_rule, skirt, tmp_path, toy_body, frames):
    write_own(tmp_path, toy_body)
    made = tmp_path / "made"
    run_rule(
        "fit_own_scans",
        input={
            "points": tmp_path / "points.npz",
            "body": tmp_path / "body.npz",
            "models": [skirt],
        },
        output={
            "folder": made / "own",
            "scans": made / "own.npz",
            "shown": made / "own_shown.npz",
        },
        params={
            "garments": ["Skirt"],
            "up": "z",
            "fps": 30,
            "body": BODY_FIT,
            "fit": FIT | {"hang_frames": frames},
            "meshing": MESHING,
            "seed": 0,
            **HANGING,
        },
    )
    with open(made / "own/garments.tsv") as stream:
        (row,) = csv.DictReader(stream, delimiter="\t")
    assert (row["scan"], row["garment"]) == ("points_001", "Skirt")
    assert float(row["points_to_garment_mm"]) < float(row["points_to_worn_mm"])
    body = load_obj(made / "own/points_001_body.obj")
    assert abs(body.vertices.mean(axis=0)[2] - TRANS[2]) < 0.3
    rest, worn, moved = (
        load_obj(made / f"own/points_001_Skirt{end}.obj") for end in ("_rest", "_worn", "")
    )
    assert len(rest.vertices) == len(worn.vertices) == len(moved.vertices)
    assert np.load(made / "own/codes.npz")["points_001_Skirt"].shape == (18,)
    assert np.load(made / "own/body.npz")["poses"].shape == (1, 72)
    run_rule(
        "plot_own_scans",
        input={"scans": made / "own.npz", "shown": made / "own_shown.npz"},
        output=[made / "own.png"],
        params={"most": 1, "rays": 0.02},
    )
    assert (made / "own.png").stat().st_size > 1000
