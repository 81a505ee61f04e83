import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES
from drapeline.motions.floor import HAND_LENGTH_M, lay_hands
from drapeline.motions.motion import Cycle, Motion
from drapeline.motions.skeleton import reference_joints

WRIST, HAND, ELBOW = (JOINT_NAMES.index(f"left_{part}") for part in ("wrist", "hand", "elbow"))


def leaning(wrist_height_m, twist_deg=0.0, slope_deg=90.0, frames=30, **changes):
    """The left forearm points down by an angle, the wrist a little above the floor."""
    poses = np.zeros((frames, 72))
    poses[:, 0] = np.pi / 2
    down = Rotation.from_euler("Z", -slope_deg, degrees=True)
    twist = Rotation.from_euler("X", twist_deg, degrees=True)
    poses[:, 48:51] = (down * twist).as_rotvec()  # left shoulder
    joints, _ = reference_joints(poses, np.zeros((frames, 3)))
    trans = np.zeros((frames, 3))
    trans[:, 2] = wrist_height_m - joints[0, WRIST, 2]
    return Motion(poses, trans, 30.0, "", "", "a", "a", **changes)


def fingertips(motion):
    joints, rotations = reference_joints(motion.poses, motion.trans)
    return joints[:, WRIST] + HAND_LENGTH_M * rotations[:, WRIST, :, 0], joints


@pytest.mark.parametrize("twist_deg", [0, 60, 90, 180, -90])
@pytest.mark.parametrize("height_m", [0.03, 0.10])
def test_fingertips_come_up_to_the_floor_and_no_further(height_m, twist_deg):
    motion = leaning(height_m, twist_deg)
    before, arm = fingertips(motion)
    assert before[0, 2] < 0
    after, kept = fingertips(lay_hands(motion))
    assert after[:, 2].min() > 0.0
    assert after[:, 2].max() < 0.06
    np.testing.assert_allclose(kept[:, [ELBOW, WRIST]], arm[:, [ELBOW, WRIST]], atol=1e-9)


def test_the_hand_bends_to_its_back():
    poses = lay_hands(leaning(0.03)).poses.reshape(-1, 24, 3)
    assert np.degrees(poses[0, WRIST, 2]) == pytest.approx(85, abs=6)  # about +Z: fingers up
    np.testing.assert_allclose(poses[:, JOINT_NAMES.index("right_wrist")], 0, atol=1e-9)


@pytest.mark.parametrize(("height_m", "slope_deg"), [(0.5, 90), (0.03, 0), (0.2, 45)])
def test_hands_clear_of_the_floor_are_left_alone(height_m, slope_deg):
    motion = leaning(height_m, slope_deg=slope_deg)
    assert lay_hands(motion) is motion


def test_hands_ease_in_and_out():
    motion = leaning(0.03, frames=60)
    motion.trans[:, 2] += np.abs(np.arange(60) - 30) * 0.03  # down to the floor and up again
    poses = lay_hands(motion).poses.reshape(-1, 24, 3)
    assert np.degrees(np.abs(np.diff(poses[:, WRIST], axis=0)).max()) < 20
    np.testing.assert_allclose(poses[[0, -1], WRIST], 0, atol=1e-9)


def test_a_cycle_eases_across_its_seam():
    motion = leaning(0.03, frames=60, cycle=Cycle(0.0, np.zeros(2)))
    motion.trans[:, 2] += np.minimum(np.arange(60), 60 - np.arange(60)) * 0.03
    poses = lay_hands(motion).poses.reshape(-1, 24, 3)
    assert np.degrees(np.abs(poses[0, WRIST] - poses[-1, WRIST]).max()) < 5
