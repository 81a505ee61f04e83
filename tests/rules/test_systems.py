"""The rules that ask systems the same questions, and those that measure a method from elsewhere."""

import shutil

import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.metrics.cost import read_costs
from drapeline.metrics.predictions import FITTED, load_fitted_scans
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import ALL, METRICS_FILE, read_metrics
from toys.metric_rows import find_value
from toys.protocol import TOLD, save_cases

MOVERS = {
    "drapeline.models.smplicit.scans.evaluate": {"moved_nearest", "moved_smoothed"},
    "drapeline.models.garment4d.scans": {"moved_interpolated"},
}


@pytest.fixture(scope="module")
def given(tmp_path_factory, toy_body):
    return save_cases(tmp_path_factory.mktemp("cases"), toy_body, window=3)


@pytest.fixture(scope="module")
def moved(run_rule, given, tmp_path_factory):
    """module -> the evaluation that its mover left."""
    folder = tmp_path_factory.mktemp("moved")
    for number, module in enumerate(MOVERS):
        run_rule(
            f"{module}:move_garments_at_rest",
            input={**given, "scans": given["clean_scans"]},
            output=[folder / str(number)],
            params={
                "skinning": {"neighbours": 16, "passes": 5},
                "body_points": 30,
                "garments": ["Skirt"],
                "split": "test",
                "seed": 3,
            },
        )
    return {module: folder / str(number) for number, module in enumerate(MOVERS)}


@pytest.fixture(scope="module")
def protocol(run_rule, given, tmp_path_factory):
    folder = tmp_path_factory.mktemp("asked") / "protocol"
    run_rule("write_protocol", input=given, output=[folder], params={"told": TOLD})
    return folder


def test_true_garments_at_rest_are_moved_into_every_scanned_frame(moved):
    for module, folder in moved.items():
        rows = read_metrics(folder / METRICS_FILE)
        assert {*rows["model"]} == {"moved"}
        assert {*rows["variant"]} == MOVERS[module] == {*read_costs([folder])["variant"]}
        for name in MOVERS[module]:
            every, common = (
                find_value(rows, name, "test", garment, "surface_to_true_mm").n
                for garment in (ALL, COMMON)
            )
            assert every == 2 * common  # of skirts and t-shirts, all models know skirts
        for found in load_fitted_scans(folder / FITTED).values():
            assert {name: {*worn} for name, worn in found.items()} == {
                name: {"Skirt", "Tshirt"} for name in MOVERS[module]
            }


def test_what_another_method_answers_stands_beside_our_own(
    run_rule, given, moved, protocol, tmp_path
):
    """It leaves every garment as it is at rest, where the wearer stands."""
    for path in protocol.glob("motion/*/*.obj"):
        mesh = load_obj(path)
        place = tmp_path / "still" / path.relative_to(protocol)
        save_obj(place, Mesh(mesh.vertices + [0.3, -0.2, 0.9], mesh.faces))
    run_rule(
        "score_predictions",
        input={**given, "meshes": sorted((tmp_path / "still").glob("*/*/*.obj"))},
        output=[tmp_path / "scored"],
        params={"told": {**TOLD, "predictions": str(tmp_path / "still")}},
    )
    rows = read_metrics(tmp_path / "scored" / METRICS_FILE)
    assert {*rows["variant"]} == {"still"}
    run_rule(
        "tabulate_systems",
        input=[*moved.values(), tmp_path / "scored"],
        output=[tmp_path / "page.html"],
    )
    page = (tmp_path / "page.html").read_text()
    for title in ("still", "Garment4D, interpolated skinning", "Skinned by smoothed weights"):
        assert title in page
    assert "Time and memory" in page


def test_a_folder_that_does_not_answer_ends_the_job_with_one_sentence(
    run_rule, given, protocol, tmp_path
):
    shutil.copytree(protocol / "motion", tmp_path / "some/motion", ignore=_but_one)
    with pytest.raises(SystemExit, match=r"drapeline: .*Skirt\.obj: no such file, expected an an"):
        run_rule(
            "score_predictions",
            input=given,
            output=[tmp_path / "scored"],
            params={"told": {**TOLD, "predictions": str(tmp_path / "some")}},
        )
    assert not (tmp_path / "scored").exists()


def _but_one(folder, names):
    """All files but the meshes of one case."""
    return [name for name in names if "." in name and not folder.endswith("00001_001")] + [
        name for name in names if name.endswith(".npz")
    ]
