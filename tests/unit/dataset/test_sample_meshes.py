import numpy as np

from drapeline.dataset import sample_meshes
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import PLAIN_COLOUR, SKIN_COLOUR, scene_parts, to_y_up
from tiny_sample import body_truth


def test_the_body_and_the_garments_move_in_the_world(tiny, toy_body):
    body, shirt, skirt = scene_parts(Sample(tiny.folder, bodies={"female": toy_body}))
    assert (body.name, shirt.name, skirt.name) == ("Body", "Tshirt", "Skirt")
    np.testing.assert_allclose(list(body.frames()), body_truth(toy_body, tiny), atol=1e-6)
    for part in (shirt, skirt):
        expected = tiny.vertices[part.name] + tiny.trans[:, None]
        np.testing.assert_allclose(list(part.frames()), expected, atol=1e-6)
        np.testing.assert_array_equal(part.mesh.faces, tiny.meshes[part.name].faces)
    assert body.colour == SKIN_COLOUR
    assert shirt.colour == (0.1, 0.5, 0.9)


def test_frames_are_read_in_chunks(tiny, monkeypatch):
    [shirt] = [part for part in scene_parts(Sample(tiny.folder)) if part.name == "Tshirt"]
    at_once = list(shirt.frames())
    monkeypatch.setattr(sample_meshes, "_CHUNK", 4)  # 6 frames: one whole chunk and a part
    np.testing.assert_array_equal(list(shirt.frames()), at_once)
    assert len(at_once) == shirt.frame_count == 6


def test_a_sample_without_body_and_colours_is_shown_plainly(tiny):
    sample = Sample(tiny.folder)
    sample.info.outfit["Skirt"]["texture"] = {"type": "pattern"}
    parts = {part.name: part for part in scene_parts(sample)}
    assert parts["Skirt"].colour == PLAIN_COLOUR

    class Bodiless(Sample):
        has_body = False

    assert [part.name for part in scene_parts(Bodiless(tiny.folder))] == ["Tshirt", "Skirt"]


def test_z_up_becomes_y_up_and_forward_becomes_z():
    np.testing.assert_array_equal(to_y_up(np.eye(3)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
