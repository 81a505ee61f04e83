"""Poses in a mirror."""

import numpy as np

from drapeline.bodies.kinematics import mirrored_poses
from drapeline.bodies.skinning import axis_angle_to_matrix
from drapeline.frames import JOINT_NAMES

POSES = np.random.default_rng(0).uniform(-2, 2, (3, 4, 72)).astype(np.float32)


def rotations(poses):
    return axis_angle_to_matrix(poses.reshape(*poses.shape[:-1], 24, 3))


def test_a_joint_turns_as_the_other_sides_mirror_image():
    """R' = S R S with S the reflection x -> -x, of the joint on the other side."""
    reflection = np.diag([-1, 1, 1])
    before, after = rotations(POSES), rotations(mirrored_poses(POSES))
    for name, other in (
        ("pelvis", "pelvis"),
        ("left_knee", "right_knee"),
        ("right_hip", "left_hip"),
    ):
        here, there = JOINT_NAMES.index(name), JOINT_NAMES.index(other)
        wanted = reflection @ before[..., there, :, :] @ reflection
        np.testing.assert_allclose(after[..., here, :, :], wanted, atol=1e-5)


def test_a_mirror_twice_changes_nothing():
    np.testing.assert_array_equal(mirrored_poses(mirrored_poses(POSES)), POSES)
    assert mirrored_poses(POSES).dtype == POSES.dtype
