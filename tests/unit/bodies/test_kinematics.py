"""Rotations, forward kinematics, and poses in a mirror."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms, mirror_poses
from drapeline.frames import JOINT_NAMES, PARENTS

POSES = np.random.default_rng(0).uniform(-2, 2, (3, 4, 72)).astype(np.float32)


def rotations(poses):
    return axis_angle_to_matrix(poses.reshape(*poses.shape[:-1], 24, 3))


def test_a_joint_turns_as_the_other_sides_mirror_image():
    """R' = S R S with S the reflection x -> -x, of the joint on the other side."""
    reflection = np.diag([-1, 1, 1])
    before, after = rotations(POSES), rotations(mirror_poses(POSES))
    for name, other in (
        ("pelvis", "pelvis"),
        ("left_knee", "right_knee"),
        ("right_hip", "left_hip"),
    ):
        here, there = JOINT_NAMES.index(name), JOINT_NAMES.index(other)
        wanted = reflection @ before[..., there, :, :] @ reflection
        np.testing.assert_allclose(after[..., here, :, :], wanted, atol=1e-5)


def test_a_mirror_twice_changes_nothing():
    np.testing.assert_array_equal(mirror_poses(mirror_poses(POSES)), POSES)
    assert mirror_poses(POSES).dtype == POSES.dtype


def test_axis_angle_equals_scipy_and_is_smooth_at_zero():
    vectors = np.random.default_rng(0).normal(size=(50, 3))
    expected = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(axis_angle_to_matrix(torch.tensor(vectors)), expected, atol=1e-12)
    zero = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    axis_angle_to_matrix(zero)[0, 1].backward()
    np.testing.assert_allclose(zero.grad, [0, 0, -1])


def test_bones_keep_their_lengths_and_the_root_its_place():
    joints = np.random.default_rng(1).normal(0, 0.3, (24, 3))
    turned = rotations(POSES[0].astype(np.float64))
    motions, places = joint_transforms(joints, turned)
    np.testing.assert_allclose(places[:, 0], np.tile(joints[0], (4, 1)))
    bones = places[:, 1:] - places[:, PARENTS[1:]]
    expected = np.linalg.norm(joints[1:] - joints[PARENTS[1:]], axis=1)
    np.testing.assert_allclose(np.linalg.norm(bones, axis=-1), np.tile(expected, (4, 1)))
    moved = np.einsum("njab,jb->nja", motions[..., :3], joints) + motions[..., 3]
    np.testing.assert_allclose(moved, places, atol=1e-12)


def test_a_joint_turns_with_all_its_ancestors():
    turned = rotations(POSES[0].astype(np.float64))
    motions, _ = joint_transforms(np.zeros((24, 3)), turned)
    hand = JOINT_NAMES.index("left_hand")
    total, joint = np.eye(3), hand
    while joint >= 0:
        total, joint = turned[:, joint] @ total, int(PARENTS[joint])
    np.testing.assert_allclose(motions[:, hand, :, :3], total, atol=1e-12)


def test_tensors_are_taken_as_arrays_are():
    turned = rotations(POSES[0])
    joints = np.random.default_rng(1).normal(0, 0.3, (24, 3)).astype(np.float32)
    expected = joint_transforms(joints, turned)
    found = joint_transforms(torch.from_numpy(joints), rotations(torch.from_numpy(POSES[0])))
    for theirs, ours in zip(found, expected, strict=True):
        np.testing.assert_allclose(theirs.numpy(), ours, atol=1e-5)
