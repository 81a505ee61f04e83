import numpy as np

from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR
from toys.tiny_sample import body_truth


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
    parts = {part.name: part for part in scene_parts(sample)}
    assert parts["Skirt"].colour == PLAIN_COLOUR

    class Bodiless(Sample):
        has_body = False

    assert [part.name for part in scene_parts(Bodiless(tiny.folder))] == ["Tshirt", "Skirt"]
