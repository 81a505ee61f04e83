import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import triangulate
from drapeline.outfits.openings import (
    WornOpenings,
    limb_bones,
    limb_openings,
    passing_limbs,
)
from toys.bodies import toy_body


def joints_in(pose):
    return posed_vertices(toy_body(), np.zeros(10), pose[None])[1][0]


def tube(top, bottom, radius=0.25, around=24):
    """Two rings of a skirt about the Z axis, and its quads."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(around)], axis=1)
    first = np.arange(around)
    second = np.roll(first, -1)
    faces = np.stack([first, second, second + around, first + around], axis=1)
    return np.concatenate([ring + [0, 0, top], ring + [0, 0, bottom]]), faces


def test_limbs_pass_through_the_openings_of_a_skirt():
    vertices, faces = tube(0.0, -0.5)
    bones = limb_bones(joints_in(REST_POSE))
    found = [passing_limbs(bones, vertices[loop]) for loop in limb_openings(vertices, faces)]
    legs = {"left leg", "right leg"}
    assert sorted(found, key=len) == [legs, legs | {"trunk"}]


def test_buttonholes_are_for_no_limb():
    vertices, faces = tube(0.0, -0.5, radius=0.015)
    assert limb_openings(vertices, faces) == []


def test_a_skirt_over_the_head_has_lost_its_waist_and_keeps_it_in_a_kick():
    vertices, faces = tube(0.08, -0.5)
    rest = joints_in(REST_POSE)
    worn = WornOpenings.at_rest(vertices, faces, rest)
    assert [vertices[loop, 2].mean() for loop in worn.loops] == [pytest.approx(0.08)]  # no hem
    assert worn.lost(vertices, rest) == []
    assert len(worn.lost(vertices + [0, 0, 1.2], rest)) == 1
    turned = REST_POSE.copy()
    turned[3 * JOINT_NAMES.index("left_hip")] -= np.deg2rad(80)
    assert worn.lost(vertices, joints_in(turned)) == []


def test_the_edge_of_an_open_front_cannot_be_lost():
    """A jacket's fronts, neck and hem are one loop, which a body may leave without a harm."""
    angle = np.linspace(0.1, 2 * np.pi - 0.1, 40)
    height = np.linspace(-0.1, 0.45, 20)
    points = np.stack(
        [
            np.tile(0.25 * np.sin(angle), (20, 1)),
            np.tile(-0.25 * np.cos(angle), (20, 1)),
            np.repeat(height[:, None], 40, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    grid = np.arange(800).reshape(20, 40)
    faces = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], -1)
    rest = joints_in(REST_POSE)
    assert WornOpenings.at_rest(points, faces.reshape(-1, 4), rest).loops == []


def test_openings_that_touch_at_a_vertex_do_not_count():
    vertices, faces = tube(0.0, -0.5)
    corner = np.array([[faces[0, 0], faces[6, 0], faces[12, 0]]])
    triangles = np.concatenate([triangulate(faces), corner])
    rest = joints_in(REST_POSE)
    assert WornOpenings.at_rest(vertices, triangles, rest).loops == []


def test_openings_that_nothing_passed_at_rest_cannot_be_lost():
    vertices, faces = tube(0.0, -0.5)
    aside = vertices + [0.8, 0, -0.9]
    rest = joints_in(REST_POSE)
    assert WornOpenings.at_rest(aside, faces, rest).lost(aside + [9, 0, 0], rest) == []
