"""Parts of a body, and which of them may collide."""

import numpy as np
import pytest

from drapeline.bodies.parts import PAIRS, PART_JOINTS, PART_NAMES, body_parts, part_of_joint
from drapeline.frames import JOINT_NAMES


@pytest.fixture(scope="module")
def parts(toy_body):
    return body_parts(toy_body)


def test_every_joint_moves_one_part():
    joints = [joint for names in PART_JOINTS.values() for joint in names]
    assert sorted(joints) == sorted(JOINT_NAMES)
    assert PART_NAMES[part_of_joint()[JOINT_NAMES.index("left_elbow")]] == "left_forearm"


def test_pairs_are_unique_and_the_same_on_both_sides():
    pairs = {frozenset((pair.first, pair.second)) for pair in PAIRS}
    assert len(pairs) == len(PAIRS)
    assert all(len(pair) == 2 for pair in pairs)

    def mirror(name):
        return name.replace("left", "*").replace("right", "left").replace("*", "right")

    limits = {frozenset((pair.first, pair.second)): pair.limit_m for pair in PAIRS}
    for pair, limit in limits.items():
        assert limits[frozenset(map(mirror, pair))] == limit


def test_parts_divide_the_vertices(parts, toy_body):
    ids = np.concatenate(parts.part_vertices)
    assert sorted(ids) == list(range(len(toy_body.v_template)))
    for own, edges in zip(parts.part_vertices, parts.part_edges, strict=True):
        assert np.isin(edges, own).all()


def test_every_vertex_knows_its_faces(parts, toy_body):
    for vertex in (7, 3, 200, 41):
        expected = np.flatnonzero((toy_body.faces == vertex).any(axis=1))
        np.testing.assert_array_equal(np.sort(parts.faces_of[vertex].indices), expected)


def test_what_is_around_vertices_shares_an_edge_with_one_of_them(parts):
    ids = np.array([12, 100])
    expected = np.flatnonzero(parts.neighbours[ids].toarray().any(axis=0))
    np.testing.assert_array_equal(parts.around(ids), expected)
    assert len(expected) > 8


def test_seams_reach_two_rings_into_the_neighbours(parts, toy_body):
    torso = PART_NAMES.index("torso")
    within = parts.seam[:, torso]
    assert within[parts.part_vertices[torso]].all()
    beyond = np.setdiff1d(np.flatnonzero(within), parts.part_vertices[torso])
    assert len(beyond)
    reach = np.zeros(len(toy_body.v_template))
    reach[parts.part_vertices[torso]] = 1
    assert (parts.neighbours @ (parts.neighbours @ reach))[beyond].all()
