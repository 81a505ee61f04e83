"""Which vertices of parts are inside others, against a slow and exact twin."""

import numpy as np
import pytest

from drapeline.bodies.inside_parts import InsideParts
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.parts import PART_NAMES, body_parts
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import vertex_normals

TORSO, LEFT, RIGHT = (
    PART_NAMES.index(name) for name in ("torso", "left_upper_arm", "right_upper_arm")
)


@pytest.fixture(scope="module")
def parts(toy_body):
    return body_parts(toy_body)


def arms_at(body, angle_rad):
    pose = REST_POSE.copy()
    pose[3 * JOINT_NAMES.index("left_shoulder") + 2] = -angle_rad
    pose[3 * JOINT_NAMES.index("right_shoulder") + 2] = angle_rad
    vertices = posed_vertices(body, np.zeros(10), pose[None])[0][0]
    # The toy is symmetric: without this, many vertices would be equally near.
    return vertices + np.random.default_rng(0).normal(0, 2e-4, vertices.shape).astype(np.float32)


def behind(vertices, before, faces, ids, others):
    """The rule, one by one: ids of vertices inside, and of those that rounding decides."""
    inside, unsure = [], []
    if not len(others):
        return inside, unsure
    normals = vertex_normals(before.astype(float), faces)
    for vertex in ids:
        ways = vertices[vertex].astype(float) - vertices[others]
        distance = np.linalg.norm(ways, axis=1)
        k = distance.argmin()
        away, height = distance[k], ways[k] @ normals[others[k]]
        steep = away < 0.015 or height < -0.5 * away
        if away < 0.06 and height < 0 and steep:
            inside.append(vertex)
        second = np.partition(distance, 1)[1]
        close = [away - 0.06, height, away - 0.015, height + 0.5 * away, second - away]
        if np.abs(close).min() < 1e-5:
            unsure.append(vertex)
    return inside, unsure


@pytest.mark.parametrize("angle_rad", [1.4, 1.5, 1.7])
def test_a_slow_twin_agrees(toy_body, parts, angle_rad):
    before = arms_at(toy_body, 0.9 * angle_rad)
    vertices = arms_at(toy_body, angle_rad)
    torso, left, right = (parts.part_vertices[part] for part in (TORSO, LEFT, RIGHT))
    questions = [(left, torso), (torso, left), (right[:0], torso), (right, torso), (torso, right)]
    found = InsideParts(parts)(vertices, before, questions)
    for (ids, others), inside in zip(questions, found, strict=True):
        expected, unsure = behind(vertices, before, parts.faces, ids, others)
        assert len(unsure) < 0.1 * len(ids) + 1
        np.testing.assert_array_equal(np.setdiff1d(inside, unsure), np.setdiff1d(expected, unsure))
    assert sum(map(len, found)) > 10


def test_answers_do_not_depend_on_what_was_asked_before(toy_body, parts):
    vertices = arms_at(toy_body, 1.5)
    torso, left, right = (parts.part_vertices[part] for part in (TORSO, LEFT, RIGHT))
    many = [(left, torso), (right, torso), (torso, left), (torso, right)] * 3
    find_inside = InsideParts(parts)
    few = find_inside(vertices, vertices, many[:1])
    all_of_them = find_inside(vertices, vertices, many)
    again = find_inside(vertices, vertices, many[:1])
    assert len(few[0])
    np.testing.assert_array_equal(few[0], all_of_them[0])
    np.testing.assert_array_equal(few[0], again[0])


def test_nothing_is_inside_nothing(toy_body, parts):
    vertices = arms_at(toy_body, 1.5)
    torso = parts.part_vertices[TORSO]
    find_inside = InsideParts(parts)
    assert find_inside(vertices, vertices, []) == []
    for question in ((torso[:0], torso), (torso, torso[:0]), (torso[:0], torso[:0])):
        (found,) = find_inside(vertices, vertices, [question])
        assert not len(found)
