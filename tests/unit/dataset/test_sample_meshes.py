import numpy as np
import pytest
import trimesh
from PIL import Image

from drapeline.dataset.gltf import write_glb
from drapeline.dataset.pictures import read_picture
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR
from drapeline.errors import DamagedFile
from toys.tiny_sample import body_truth, write_tiny_sample


def test_the_body_and_the_garments_move_in_the_world(tiny, toy_body):
    body, shirt, skirt = scene_parts(Sample(tiny.folder, bodies={"female": toy_body}))
    assert (body.name, shirt.name, skirt.name) == ("Body", "Tshirt", "Skirt")
    np.testing.assert_allclose(list(body.frames()), body_truth(toy_body, tiny), atol=1e-6)
    for part in (shirt, skirt):
        expected = tiny.vertices[part.name] + tiny.trans[:, None]
        np.testing.assert_allclose(list(part.frames()), expected, atol=1e-6)
        np.testing.assert_array_equal(part.mesh.faces, tiny.meshes[part.name].faces)
    assert body.colour == BODY_COLOUR
    assert shirt.colour == (0.1, 0.5, 0.9)


def test_a_sample_without_body_and_colours_is_shown_plainly(tiny):
    sample = Sample(tiny.folder)
    sample.info.outfit["Skirt"]["texture"] = {"type": "pattern"}
    for garment in sample.meta["outfit"]["garments"]:
        garment.pop("texture", None)
    parts = {part.name: part for part in scene_parts(sample)}
    assert parts["Skirt"].colour == PLAIN_COLOUR

    class Bodiless(Sample):
        has_body = False

    assert [part.name for part in scene_parts(Bodiless(tiny.folder))] == ["Tshirt", "Skirt"]


PRINT = {"kind": "gingham", "size_m": 0.05, "colours": [[0.8, 0, 0], [1, 1, 1]], "seed": 1}


@pytest.fixture
def printed(tmp_path, toy_body):
    return write_tiny_sample(tmp_path, toy_body, prints={"Skirt": PRINT}).folder


def test_a_print_is_a_picture_as_in_cloth3d(printed):
    with Image.open(printed / "Skirt.png") as picture:
        assert (picture.size, picture.mode) == ((2048, 2048), "RGB")
    with Sample(printed) as sample:
        assert sample.texture("Skirt") == printed / "Skirt.png"
        assert sample.texture("Tshirt") is None
        assert sample.info.outfit["Skirt"]["texture"] == {"type": "pattern"}
        sample.verify()
        parts = {part.name: part for part in scene_parts(sample)}
    assert parts["Skirt"].texture == printed / "Skirt.png"
    assert parts["Skirt"].colour == (0.1, 0.5, 0.9)  # as the record says
    assert parts["Tshirt"].texture is None


def test_a_print_that_is_cut_off_is_refused(printed):
    picture = printed / "Skirt.png"
    picture.write_bytes(picture.read_bytes()[:5000])
    with pytest.raises(DamagedFile, match=r"Skirt\.png"):
        read_picture(picture)


def test_gltf_carries_the_print(printed, tmp_path):
    with Sample(printed) as sample:
        write_glb(tmp_path / "a.glb", scene_parts(sample))
    scene = trimesh.load_scene(tmp_path / "a.glb")
    with Image.open(printed / "Skirt.png") as picture:
        found = scene.geometry["Skirt"].visual.material.baseColorTexture
        np.testing.assert_array_equal(np.asarray(found.convert("RGB")), np.asarray(picture))
    assert scene.geometry["Tshirt"].visual.material.baseColorTexture is None
