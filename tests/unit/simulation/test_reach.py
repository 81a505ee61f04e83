import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.simulation.reach import parts_within_reach


def hands(body):
    return np.isin(body.segmentation, [JOINT_NAMES.index(f"{s}_hand") for s in ("left", "right")])


@pytest.fixture
def vest(toy_body):
    """Cloth right on the trunk."""
    rest = posed_vertices(toy_body, np.zeros(10), REST_POSE[None].copy())[0][0]
    trunk = [JOINT_NAMES.index(name) for name in ("spine1", "spine2", "spine3")]
    return rest, rest[np.isin(toy_body.segmentation, trunk)]


def test_hands_head_and_feet_far_from_a_vest_do_not_collide(toy_body, vest):
    rest, cloth = vest
    kept = parts_within_reach(toy_body, [rest], [cloth])
    ends = [JOINT_NAMES.index(n) for n in ("head", "left_hand", "right_hand", "left_foot")]
    assert not kept[np.isin(toy_body.segmentation, ends)].any()
    assert kept[np.isin(toy_body.segmentation, [0, 3, 6, 9, 16, 17])].all()


def test_a_hand_that_comes_near_in_any_frame_collides(toy_body, vest):
    rest, cloth = vest
    near = rest.copy()
    left = toy_body.segmentation == JOINT_NAMES.index("left_hand")
    near[left] += cloth.mean(axis=0) + [0, -0.2, 0] - rest[left].mean(axis=0)
    kept = parts_within_reach(toy_body, [rest] * 5 + [near], [cloth])
    assert kept[left].all()
    assert not kept[hands(toy_body) & ~left].any()


def test_a_sleeve_over_the_hand_keeps_the_hand(toy_body, vest):
    rest, cloth = vest
    kept = parts_within_reach(toy_body, [rest], [cloth, rest[hands(toy_body)]])
    assert kept[hands(toy_body)].all()
