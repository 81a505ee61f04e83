"""The skeleton's order and the rest pose."""

import numpy as np

from drapeline.frames import JOINT_NAMES, PARENTS, REST_POSE


def test_parents_come_before_their_children_and_stay_on_one_side():
    assert len(JOINT_NAMES) == len(PARENTS) == 24
    assert PARENTS[0] == -1
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        assert 0 <= parent < joint
        sides = {JOINT_NAMES[j].partition("_")[0] for j in (joint, parent)} & {"left", "right"}
        assert len(sides) <= 1, f"{JOINT_NAMES[joint]} hangs on {JOINT_NAMES[parent]}"


def test_the_rest_pose_stands_upright_and_opens_the_legs_symmetrically():
    turned = {name: REST_POSE[3 * i : 3 * i + 3] for i, name in enumerate(JOINT_NAMES)}
    np.testing.assert_allclose(turned.pop("pelvis"), [np.pi / 2, 0, 0])  # Y up to Z up
    np.testing.assert_array_equal(turned.pop("left_hip"), [0, 0, 0.15])
    np.testing.assert_array_equal(turned.pop("right_hip"), [0, 0, -0.15])
    assert not np.any(list(turned.values()))
    assert not REST_POSE.flags.writeable
    assert not PARENTS.flags.writeable
