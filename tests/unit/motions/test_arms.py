import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES
from drapeline.motions.arms import steady_upper_arms
from drapeline.motions.skeleton import reference_joints

SHOULDER, ELBOW, WRIST = (
    JOINT_NAMES.index(f"left_{part}") for part in ("shoulder", "elbow", "wrist")
)


def swinging(elbow_deg, pop_deg=30.0, frames=60):
    """An arm lowered by 70 degrees whose twist jumps halfway."""
    poses = np.zeros((frames, 24, 3))
    twist = np.where(np.arange(frames) < frames // 2, 0.0, np.radians(pop_deg))
    down = Rotation.from_rotvec(np.tile([0, 0, -np.radians(70)], (frames, 1)))
    about = Rotation.from_rotvec(twist[:, None] * [1.0, 0, 0])
    poses[:, SHOULDER] = (down * about).as_rotvec()
    poses[:, ELBOW, 1] = -np.radians(elbow_deg)
    return poses.reshape(frames, 72)


def largest_step_deg(poses):
    turn = Rotation.from_rotvec(poses.reshape(-1, 24, 3)[:, SHOULDER])
    return np.degrees((turn[:-1].inv() * turn[1:]).magnitude().max())


def limbs(poses):
    joints, _ = reference_joints(poses, np.zeros((len(poses), 3)))
    return joints[:, ELBOW] - joints[:, SHOULDER], joints[:, WRIST] - joints[:, ELBOW]


def test_a_straight_arms_twist_does_not_jump():
    poses = swinging(elbow_deg=3.0)
    steady = steady_upper_arms(poses, fps=30, cyclic=False)
    assert largest_step_deg(poses) == pytest.approx(30)
    assert largest_step_deg(steady) < 5
    (upper, fore), (upper_before, fore_before) = limbs(steady), limbs(poses)
    np.testing.assert_allclose(upper, upper_before, atol=1e-9)
    assert np.linalg.norm(fore - fore_before, axis=1).max() < 0.01
    others = np.delete(np.arange(24), SHOULDER)
    np.testing.assert_array_equal(
        steady.reshape(-1, 24, 3)[:, others], poses.reshape(-1, 24, 3)[:, others]
    )


def test_a_bent_arm_keeps_what_was_captured():
    poses = swinging(elbow_deg=60.0)
    np.testing.assert_allclose(steady_upper_arms(poses, fps=30, cyclic=False), poses, atol=1e-9)


def test_a_cycle_is_smooth_across_its_seam():
    steady = steady_upper_arms(swinging(elbow_deg=3.0), fps=30, cyclic=True)
    assert largest_step_deg(np.concatenate([steady, steady])) < 5
