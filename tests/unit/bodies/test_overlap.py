from types import SimpleNamespace

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh.creation import icosphere

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.overlap import measure_overlap
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import vertex_normals


@pytest.fixture
def folded(toy_body):
    """(4, V, 3) a body whose left hand is in its right thigh in the first frame."""
    vertices = posed_vertices(toy_body, np.zeros(10), np.zeros((4, 72)))[0]
    hand, thigh = (
        np.flatnonzero(toy_body.segmentation == JOINT_NAMES.index(name))
        for name in ("left_hand", "right_hip")
    )
    vertices[0, hand] += vertices[0, thigh].mean(axis=0) - vertices[0, hand].mean(axis=0)
    return vertices, hand


def everything(body):
    return np.ones(len(body.v_template), dtype=bool)


def test_a_body_at_rest_does_not_overlap(toy_body):
    vertices = posed_vertices(toy_body, np.zeros(10), np.zeros((1, 72)))[0]
    assert measure_overlap(toy_body, vertices, everything(toy_body)) == (0, 0)


def test_a_hand_in_a_thigh_counts_in_its_frame(toy_body, folded):
    vertices, hand = folded
    alone = measure_overlap(toy_body, vertices[:1], everything(toy_body))
    both = measure_overlap(toy_body, vertices, everything(toy_body))
    assert alone.share > 0.5 * len(hand) / len(toy_body.v_template)
    assert alone.depth_m > 0.03
    assert both.share == pytest.approx(alone.share / 2)  # the first and the fourth frame
    assert both.depth_m == alone.depth_m


def test_what_takes_no_part_does_not_count(toy_body, folded):
    vertices, _ = folded
    arm = [JOINT_NAMES.index(f"left_{name}") for name in ("elbow", "wrist", "hand")]
    collides = ~np.isin(toy_body.segmentation, arm)
    assert measure_overlap(toy_body, vertices[:1], collides) == (0, 0)


RADIUS_M = 0.1


@pytest.fixture(scope="module")
def thighs():
    """A body of two balls that are apart at rest."""
    ball = icosphere(subdivisions=4, radius=RADIUS_M)
    hips = [JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("right_hip")]
    return SimpleNamespace(
        v_template=np.concatenate([ball.vertices, ball.vertices + [1, 0, 0]]),
        faces=np.concatenate([ball.faces, ball.faces + len(ball.vertices)]).astype(np.int32),
        segmentation=np.repeat(hips, len(ball.vertices)),
    )


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.48, 0.6, 0.64)])
def test_thighs_that_meet_are_as_deep_in_each_other_as_balls(thighs, way):
    half = len(thighs.v_template) // 2
    first = thighs.v_template[:half]
    posed = np.concatenate([first, first + 0.15 * np.array(way)])
    centres = np.repeat([0.15 * np.array(way), np.zeros(3)], half, axis=0)
    deep = RADIUS_M - np.linalg.norm(posed - centres, axis=1)
    found = measure_overlap(thighs, posed[None], everything(thighs))
    assert (deep > 0.001).mean() <= found.share <= (deep > -0.001).mean()
    assert found.depth_m == pytest.approx(0.05, abs=0.004)
    apart = np.concatenate([first, first + 0.203 * np.array(way)])
    assert measure_overlap(thighs, apart[None], everything(thighs)) == (0, 0)


@pytest.mark.parametrize(
    "joints",
    [
        {"left_elbow": 1, "right_knee": 0},
        {"left_shoulder": 2, "right_shoulder": 1},
        {"left_hip": 0, "spine1": 0, "spine2": 0},
    ],
)
def test_bent_bodies_overlap_as_generalised_winding_numbers_say(toy_body, joints):
    poses = np.zeros((1, 24, 3))
    for joint, axis in joints.items():
        poses[0, JOINT_NAMES.index(joint), axis] = 2.4
    poses[0, 0] = Rotation.from_euler("xyz", [0.3, 0.5, 0.2]).as_rotvec()
    vertices = posed_vertices(toy_body, np.zeros(10), poses.reshape(1, 72))[0]
    places = vertices[0] + 1e-4 * vertex_normals(vertices[0].astype(float), toy_body.faces)
    windings = igl.winding_number(
        vertices[0].astype(float), toy_body.faces.astype(np.int64), places
    )
    expected = (windings > 0.5).mean()
    assert expected > 0.01
    found = measure_overlap(toy_body, vertices, everything(toy_body))
    assert found.share == pytest.approx(expected, abs=2 / len(places))
