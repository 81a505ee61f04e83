import numpy as np
import pytest

from drapeline.frames import JOINT_NAMES
from drapeline.xpbd.limbs import hand_numbers, home_limbs, split_limbs


def test_each_limb_holds_its_own_joints_and_little_else(toy_body):
    parts = split_limbs(toy_body.v_template, toy_body.faces, toy_body.segmentation)
    trunk, left_arm, left_leg, right_arm, right_leg, whole = parts
    assert len(whole) == len(toy_body.faces)

    def joints(part):
        return {JOINT_NAMES[k] for k in np.unique(toy_body.segmentation[toy_body.faces[part]])}

    assert {"left_shoulder", "left_elbow", "left_hand"} <= joints(left_arm)
    assert not joints(left_arm) & {"left_hip", "right_shoulder", "right_hand", "head"}
    assert {"left_hip", "left_knee", "left_foot"} <= joints(left_leg)
    assert not joints(left_leg) & {"left_hand", "right_foot", "head"}
    assert not joints(trunk) & {"left_hand", "right_elbow", "left_foot"}
    assert len(left_arm) == pytest.approx(len(right_arm), rel=0.1)
    assert len(left_leg) == pytest.approx(len(right_leg), rel=0.1)
    assert len(np.unique(np.concatenate(parts[:-1]))) == len(whole)


def test_cloth_lies_on_the_limb_next_to_it_or_on_none(toy_body):
    wanted = {"spine2": 0, "left_elbow": 1, "right_knee": 4}
    numbers = [
        np.flatnonzero(toy_body.segmentation == JOINT_NAMES.index(joint))[0] for joint in wanted
    ]
    cloth = np.concatenate([toy_body.v_template[numbers], [[0, 3.0, 0]]])
    homes = home_limbs(toy_body.v_template, toy_body.segmentation, cloth)
    assert homes.tolist() == [*wanted.values(), 5]


def test_hands_are_told_from_arms_and_by_side(toy_body):
    numbers = hand_numbers(toy_body.faces, toy_body.segmentation)
    wanted = {"left_shoulder": 0, "right_elbow": 0, "left_hand": 1, "right_hand": 2, "spine2": 0}
    for joint, number in wanted.items():
        whole = (toy_body.segmentation[toy_body.faces] == JOINT_NAMES.index(joint)).all(axis=1)
        assert whole.any()
        assert (numbers[whole] == number).all()
