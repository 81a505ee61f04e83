"""The rules of SMPLicit's gallery, on a model whose fields are exact tubes."""

import csv

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.sequence import save_body_sequence
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.gallery.plan import SHEETS
from drapeline.models.smplicit.model import SmplicitModel, body_file
from drapeline.models.smplicit.surface.sheet import FieldGarment
from drapeline.simulation.settings import HealthBounds
from toys.bounds import NO_BOUNDS
from toys.gallery import TubeField, save_toy_model, save_toy_outfits, training_codes

MESHING = {"cell_m": 0.03, "threshold_m": 0.018}
SIMULATION = {
    "steps_min": 6,
    "steps_max": 6,
    "shape_frames": 1,
    "pose_frames": 2,
    "settle_frames": 0,
    "collider_share": 1.0,
    "attempts": 1,
}


@pytest.fixture(scope="module")
def exact_fields():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
        yield


@pytest.fixture(scope="module")
def made(run_rule, tmp_path_factory, toy_body, exact_fields):
    folder = tmp_path_factory.mktemp("smplicit")
    codes = training_codes()
    save_toy_model(folder / "skirt", toy_body, codes)
    save_toy_outfits(folder / "outfits_at_rest", codes)
    run_rule(
        "drapeline.models.smplicit.gallery.files:make_gallery",
        input={"model": folder / "skirt", "outfits": [folder / "outfits_at_rest"]},
        output=[folder / "gallery"],
        params={"samples": 2, "seed": 0, "meshing": MESHING},
    )
    return folder


def table(path):
    with open(path) as stream:
        return list(csv.DictReader(stream, delimiter="\t"))


def test_every_garment_has_its_files(made):
    rows = table(made / "gallery" / "garments.tsv")
    assert {row["sheet"] for row in rows} == set(SHEETS)
    for row in rows:
        assert (made / "gallery" / f"{row['name']}.obj").is_file() == (row["vertices"] != "0")
        assert (made / "gallery" / f"{row['name']}.glb").is_file()


def test_edited_tubes_measure_what_was_asked_for(made):
    edits = [row for row in table(made / "gallery" / "garments.tsv") if row["sheet"] == "edits"]
    lengths = [row for row in edits if row["about"] == "leg"]
    assert len(lengths) == 5
    for row in lengths:
        assert float(row["leg"]) == pytest.approx(float(row["asked"]), abs=5)  # half a cell


def test_sheets_are_drawn(run_rule, made, tmp_path):
    run_rule(
        "drapeline.models.smplicit.figures:plot_sheets",
        input={
            "gallery": made / "gallery",
            **{gender: body_file(made / "skirt", gender) for gender in GENDERS},
        },
        output={sheet: tmp_path / f"{sheet}.png" for sheet in SHEETS},
        params={"rays": 0.02},
    )
    for sheet in SHEETS:
        picture = np.asarray(Image.open(tmp_path / f"{sheet}.png").convert("RGB")).astype(int)
        assert (np.ptp(picture, axis=2) > 25).mean() > 0.01, sheet


@pytest.fixture
def pose_garment(run_rule, made, tmp_path, toy_body):
    """pose_garment(...) runs the rule and gives the files that it wrote."""
    poses = np.tile(REST_POSE, (6, 1))
    poses[:, 3 * 1] = np.linspace(0, 0.5, 6)
    record = make_body_sequence(toy_body, np.zeros(10), poses, np.zeros((6, 3)), gender="female")
    save_body_sequence(tmp_path / "bodies" / "00001.npz", record)

    def run(**changes):
        names = {"sheet": "sheet.png", "moving": "moving.png", "scene": "scene.glb"}
        output = {key: tmp_path / name for key, name in names.items()}
        run_rule(
            "drapeline.models.smplicit.figures:pose_garment",
            input={
                "model": made / "skirt",
                "gallery": made / "gallery",
                "bodies": tmp_path / "bodies",
            },
            output=output,
            params={
                "sample": "00001",
                "solver": "drapeline.xpbd.solver",
                "frames": 4,
                "shown": 2,
                "skinning": "smoothed",
                "push_out": True,
                "simulate": False,
                "edge_length_m": 0.04,
                "simulation": SIMULATION,
                "bounds": NO_BOUNDS.plain(),
                "meshing": MESHING,
                "rays": 0.02,
                **changes,
            },
        )
        return output

    return run


def test_a_garment_is_posed(pose_garment):
    output = pose_garment()
    with Image.open(output["moving"]) as moving:
        assert moving.n_frames == 2
    assert output["scene"].read_bytes()[:4] == b"glTF"


def test_a_prototype_of_which_nothing_is_left_is_named(pose_garment, monkeypatch):
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    empty = FieldGarment(nothing, nothing)
    monkeypatch.setattr(SmplicitModel, "decode", lambda self, z, **wearer: empty)
    with pytest.raises(SystemExit, match="nothing is left of the prototype '.*' on the wearer"):
        pose_garment()


def test_a_simulated_garment_is_shown_below_the_skinned_ones(pose_garment, tmp_path):
    def run(**changes):
        output = pose_garment(**changes)
        with Image.open(output["sheet"]) as sheet:
            return sheet.height, output["scene"].read_bytes()

    skinned, simulated = run(), run(simulate=True)
    assert simulated[0] == pytest.approx(1.5 * skinned[0], rel=0.05)
    assert simulated[1] != skinned[1]
    out_of_bounds = HealthBounds(stretch_low=0.999, stretch_high=1.001).plain()
    assert run(simulate=True, bounds=out_of_bounds) == skinned


def test_codes_have_a_page_and_a_table(run_rule, made, tmp_path):
    run_rule(
        "drapeline.report.models.smplicit.tables:tabulate_gallery",
        input={"galleries": [made / "gallery"]},
        output={"page": tmp_path / "page.html", "table": tmp_path / "all.tsv"},
        params={"models": ["skirt"]},
    )
    found = {(row["axis"], row["property"]): row for row in table(tmp_path / "all.tsv")}
    # Length is what the toy's first number says, which varies most.
    assert float(found["1", "leg"]["correlation"]) > 0.9
    assert "<td>skirt</td>" in (tmp_path / "page.html").read_text()
