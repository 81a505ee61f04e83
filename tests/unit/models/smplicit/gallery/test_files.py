"""Files of a gallery, of a model whose fields are exact tubes."""

import csv

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.obj import load_obj
from drapeline.models.smplicit.gallery.files import load_gallery, posed_prototype, save_gallery
from drapeline.models.smplicit.gallery.plan import Shown, code_space, training_measures
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from toys.gallery import (
    TubeField,
    save_toy_model,
    toy_outfits,
    training_codes,
    tube_size,
)

CODES = training_codes()
MESHING = Meshing(cell_m=0.02, threshold_m=0.012)


def far_away(z):
    """A code of a tube that is not within the box."""
    gone = z.copy()
    gone[1] = 40
    return gone


@pytest.fixture(scope="module")
def saved(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("gallery")
    save_toy_model(folder / "skirt", toy_body, CODES)
    model = SmplicitModel(folder / "skirt")
    model.field = lambda z, *, gender, shape: TubeField(z)
    space = code_space("skirt", CODES, training_measures(model, toy_outfits(CODES)), 6)
    z = np.zeros(model.latent)
    longer = space.edits.edit(z, {"leg": 0.1})
    asked = float(space.edits.predict(longer)[0])
    shown = [
        Shown("prototypes", "female", "short skirt", z),
        Shown("prototypes", "female", "long skirt", longer),
        Shown("edits", "length", "", longer, about="leg", asked=asked),
        Shown("samples", "of codes", "1", far_away(z), "male"),
    ]
    rows = save_gallery(folder / "gallery", model, shown, space, MESHING)
    return folder / "gallery", rows, shown, space


def test_a_garment_that_is_shown_twice_is_made_once(saved):
    folder, rows, _, _ = saved
    assert [row["name"] for row in rows] == ["001", "002", "002", "003"]
    assert sorted(path.name for path in folder.glob("*.obj")) == ["001.obj", "002.obj"]
    assert sorted(path.name for path in folder.glob("*.glb")) == [f"00{k}.glb" for k in (1, 2, 3)]


def test_meshes_are_those_of_their_codes(saved):
    folder, _, shown, _ = saved
    for name, item in (("001", shown[0]), ("002", shown[1])):
        hem, top, radius = tube_size(item.z)
        vertices = load_obj(folder / f"{name}.obj").vertices
        # One number, since the vertices of two processors are not the same places.
        assert np.abs(np.linalg.norm(vertices[:, :2], axis=1) - radius).max() < 0.004
        assert vertices[:, 2].min() == pytest.approx(hem, abs=0.02)
        assert vertices[:, 2].max() == pytest.approx(top, abs=0.02)


def test_an_edit_is_measured_on_the_mesh_as_it_was_asked_for(saved):
    _, rows, _, _ = saved
    before, edited = rows[0], rows[2]
    assert edited["leg"] == pytest.approx(edited["asked"], abs=3)
    assert edited["leg"] - before["leg"] == pytest.approx(10, abs=1.5)
    assert edited["waist"] == pytest.approx(before["waist"], abs=1)


def test_nothing_left_is_said_and_has_only_its_wearer(saved):
    folder, rows, _, _ = saved
    assert rows[3]["vertices"] == 0
    assert np.isnan(rows[3]["leg"])
    assert rows[3]["like_training"] == "false"
    assert rows[0]["like_training"] == "true"
    assert [row["openings"] for row in rows] == [2, 2, 2, 0]
    assert (folder / "003.glb").read_bytes()[:4] == b"glTF"


def test_tables_hold_what_was_found(saved):
    folder, rows, _, space = saved
    tables = {}
    for name in ("garments", "correlations", "regressions"):
        with open(folder / f"{name}.tsv") as stream:
            tables[name] = list(csv.DictReader(stream, delimiter="\t"))
    assert [row["name"] for row in tables["garments"]] == [row["name"] for row in rows]
    assert tables["garments"][3]["leg"] == ""
    found = {(int(r["axis"]), r["property"]): r["correlation"] for r in tables["correlations"]}
    assert float(found[1, "leg"]) == pytest.approx(space.correlation[0, 0], rel=1e-5)
    assert float(found[1, "waist"]) == pytest.approx(space.correlation[0, 1], abs=1e-5)
    told = {row["property"]: row for row in tables["regressions"]}
    assert float(told["leg"]["explained_share"]) == pytest.approx(1, abs=1e-4)
    assert float(told["leg"]["mean"]) == pytest.approx(100 * space.values["leg"].mean(), rel=1e-5)


def test_a_gallery_is_read_as_it_was_written(saved, toy_body):
    folder, rows, shown, _ = saved
    bodies = dict.fromkeys(GENDERS, toy_body)
    read = load_gallery(folder, bodies)
    assert [(g.sheet, g.row, g.column) for g in read] == [
        (item.sheet, item.row, item.column) for item in shown
    ]
    assert [len(garment.mesh.vertices) for garment in read] == [row["vertices"] for row in rows]
    assert read[2].caption == f"{rows[2]['asked']:.0f} asked, {rows[2]['leg']:.0f} % of the leg"
    assert read[0].caption == ""
    assert read[0].garment == "Skirt"
    assert len(read[0].wearer.vertices) == len(toy_body.v_template)


def test_the_posed_prototype_is_the_second(saved):
    folder, _, shown, _ = saved
    name, z = posed_prototype(folder)
    assert name == "long skirt"
    assert z == pytest.approx(shown[1].z, abs=1e-6)


def test_a_missing_gallery_is_refused(tmp_path, toy_body):
    with pytest.raises(InputError, match="codes.npz"):
        load_gallery(tmp_path, dict.fromkeys(GENDERS, toy_body))
    with pytest.raises(InputError, match="codes.npz"):
        posed_prototype(tmp_path)
