"""Properties of garments, on tubes and sleeves of known lengths."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.properties import measure_properties
from toys.gallery import tube_mesh, tube_size

MEAN = np.zeros(10)


def joints(body, shape=MEAN):
    places = posed_vertices(body, shape, REST_POSE[None])[1][0]
    return dict(zip(JOINT_NAMES, places.astype(float), strict=True))


def box(low, high, cells=24):
    """The walls of a box that is open above and below, with vertices in its middle planes."""
    ring = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    around = [
        (1 - t) * np.array(a) + t * np.array(b)
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
        for t in np.arange(cells) / cells
    ]
    n = len(around)
    vertices = [[*place, height] for height in (low[2], high[2]) for place in around]
    k = np.arange(n)
    after = (k + 1) % n
    faces = np.concatenate(
        [np.stack([k, after, after + n], axis=1), np.stack([k, after + n, k + n], axis=1)]
    )
    return Mesh(np.array(vertices, np.float32), faces.astype(np.int32))


def both(*meshes):
    start = np.cumsum([0, *[len(mesh.vertices) for mesh in meshes[:-1]]])
    faces = [mesh.faces + first for mesh, first in zip(meshes, start, strict=True)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces).astype(np.int32)
    )


def test_a_skirt_is_as_long_as_its_share_of_the_leg(toy_body):
    at = joints(toy_body)
    z = np.array([1.3, 0.0, 0.1])
    hem, top, _ = tube_size(z)
    found = measure_properties("lower", tube_mesh(z), toy_body, MEAN)
    hip, ankle, neck = (at[name][2] for name in ("left_hip", "left_ankle", "neck"))
    assert found["leg"] == pytest.approx((hip - hem) / (hip - ankle), abs=1e-5)
    assert found["waist"] == pytest.approx((top - hip) / (neck - hip), abs=1e-5)


def test_looseness_grows_with_the_radius(toy_body):
    narrow, wide = (
        measure_properties("lower", tube_mesh(np.array([0.0, at, 0.0])), toy_body, MEAN)["width"]
        for at in (0.0, 1.0)
    )
    assert narrow < wide < narrow + 0.0201


def test_a_garment_on_the_skin_has_no_looseness(toy_body):
    skin = posed_vertices(toy_body, MEAN, REST_POSE[None])[0][0]
    found = measure_properties("upper", Mesh(skin, toy_body.faces), toy_body, MEAN)
    assert found["width"] == pytest.approx(0, abs=1e-6)


def test_properties_are_of_the_cut_and_not_of_the_wearers_size(toy_body):
    at, taller = joints(toy_body), joints(toy_body, np.eye(10)[0] * 2)
    scale = taller["left_ankle"][2] / at["left_ankle"][2]
    assert abs(scale - 1) > 0.02
    mesh = tube_mesh(np.zeros(3))
    grown = Mesh(scale * mesh.vertices, mesh.faces)
    found = [
        measure_properties("lower", garment, toy_body, shape)
        for garment, shape in ((mesh, MEAN), (grown, np.eye(10)[0] * 2))
    ]
    for name in ("leg", "waist"):
        assert found[1][name] == pytest.approx(found[0][name], rel=1e-3)


@pytest.mark.parametrize("share", [0.25, 0.8])
def test_sleeves_reach_as_far_as_they_do(toy_body, share):
    at = joints(toy_body)
    reach = (1 - share) * at["left_shoulder"][0] + share * at["left_wrist"][0]
    height = at["left_shoulder"][2]
    trunk = box((-0.15, -0.15, -0.1), (0.15, 0.15, height))
    sleeves = box((-reach, -0.05, height - 0.06), (reach, 0.05, height + 0.06))
    found = measure_properties("upper", both(trunk, sleeves), toy_body, MEAN)
    assert found["sleeve"] == pytest.approx(share, abs=1e-4)
    without = measure_properties("upper", trunk, toy_body, MEAN)
    assert without["sleeve"] == 0
    hip, neck = at["left_hip"][2], at["neck"][2]
    assert without["hem"] == pytest.approx((neck + 0.1) / (neck - hip), abs=1e-5)


def test_a_wide_hem_is_no_sleeve(toy_body):
    wide = box((-0.6, -0.2, -0.2), (0.6, 0.2, -0.05))
    assert measure_properties("upper", wide, toy_body, MEAN)["sleeve"] == 0


def test_the_neckline_is_that_of_the_front(toy_body):
    at = joints(toy_body)
    back, neck, hip = at["neck"][1], at["neck"][2], at["left_hip"][2]
    front = box((-0.15, back - 0.15, -0.1), (0.15, back - 0.1, neck - 0.12), cells=8)
    behind = box((-0.15, back + 0.1, -0.1), (0.15, back + 0.15, neck), cells=8)
    found = measure_properties("upper", both(front, behind), toy_body, MEAN)["neckline"]
    assert found == pytest.approx(0.12 / (neck - hip), abs=1e-4)


def test_what_is_open_in_front_has_no_neckline(toy_body):
    at = joints(toy_body)
    back = at["neck"][1]
    sides = [
        box((side * 0.05 - 0.03, back - 0.15, -0.1), (side * 0.05 + 0.03, back - 0.1, 0.2))
        for side in (-1, 1)
    ]
    found = measure_properties("upper", both(*sides), toy_body, MEAN)
    assert np.isnan(found["neckline"])
    assert np.isfinite([found["sleeve"], found["hem"], found["width"]]).all()
