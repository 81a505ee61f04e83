import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.motions.skeleton import (
    REFERENCE_LEG_LENGTH_M,
    REFERENCE_OFFSETS,
    globals_from_poses,
    poses_from_globals,
    reference_joints,
)


def test_pose_vectors_survive_global_rotations():
    rng = np.random.default_rng(0)
    poses = rng.uniform(-1.5, 1.5, (20, 72))
    np.testing.assert_allclose(poses_from_globals(globals_from_poses(poses)), poses, atol=1e-9)


def test_rest_pose_stands_upright_and_faces_minus_y():
    joints, rotations = reference_joints(REST_POSE[None], np.zeros((1, 3)))
    place = dict(zip(JOINT_NAMES, joints[0], strict=True))
    assert place["head"][2] > 0.4
    assert place["left_ankle"][2] < -0.7
    assert place["left_wrist"][0] > 0.5
    np.testing.assert_allclose(rotations[0, 0] @ [0, 0, 1], [0, -1, 0], atol=1e-12)


def test_joints_equal_a_walk_down_the_chain():
    rng = np.random.default_rng(1)
    poses, trans = rng.uniform(-1, 1, (1, 72)), rng.normal(size=(1, 3))
    joints, _ = reference_joints(poses, trans)
    turn = Rotation.from_rotvec(poses[0, :3])
    place = trans[0].copy()
    for name in ("left_hip", "left_knee", "left_ankle"):  # slow twin along one limb
        index = JOINT_NAMES.index(name)
        place = place + turn.as_matrix() @ REFERENCE_OFFSETS[index]
        np.testing.assert_allclose(joints[0, index], place, atol=1e-12)
        turn = turn * Rotation.from_rotvec(poses[0, 3 * index : 3 * index + 3])


def test_leg_length_scales_the_skeleton():
    joints, _ = reference_joints(np.zeros((1, 72)), np.zeros((1, 3)), leg_length_m=1.64)
    small, _ = reference_joints(np.zeros((1, 72)), np.zeros((1, 3)))
    np.testing.assert_allclose(joints, small * 1.64 / REFERENCE_LEG_LENGTH_M)
