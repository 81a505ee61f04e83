from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES
from drapeline.motions.floor import (
    MAX_SHIFT_M,
    SOLES_BY_SIDE,
    floor_report,
    lock_feet,
    set_on_floor,
    sole_rests,
    touch_points,
)
from drapeline.motions.motion import Cycle, Motion, loop_to
from drapeline.motions.skeleton import reference_joints

KNEE = slice(3 * 4, 3 * 4 + 3)


def crouching(frames=60, **changes):
    """Stand with bent knees while the pelvis sways, so that the feet slide along with it."""
    poses = np.zeros((frames, 72))
    poses[:, 0] = np.pi / 2
    for name, bend in (("hip", -0.4), ("knee", 0.8), ("ankle", -0.4)):
        for side in ("left", "right"):
            poses[:, 3 * JOINT_NAMES.index(f"{side}_{name}")] = bend
    trans = np.zeros((frames, 3))
    phase = 2 * np.pi * np.arange(frames) / 60
    trans[:, 0] = 0.02 * np.sin(phase)
    trans[:, 1] = 0.01 * np.cos(phase)
    trans[:, 2] = 0.9
    motion = Motion(poses, trans, 30.0, "", "", "a", "a", **changes)
    return set_on_floor(motion, feet=False, hands=False)


def test_resting_feet_stop_sliding():
    motion = crouching()
    assert floor_report(motion).sliding_mm_per_frame > 1.0
    locked = lock_feet(motion)
    assert floor_report(locked).sliding_mm_per_frame < 0.01
    soles = touch_points(locked.poses, locked.trans)[:, SOLES_BY_SIDE[0]]
    assert np.ptp(soles, axis=0).max() < 1e-6
    np.testing.assert_allclose(soles[..., 2], 0, atol=1e-6)
    np.testing.assert_array_equal(locked.trans, motion.trans)


def test_no_foot_is_moved_further_than_ten_centimetres():
    """Feet that creep by half a metre in ten seconds: stopping them would take a quarter of one."""
    motion = crouching(frames=300)
    trans = motion.trans.copy()
    trans[:, 0] = np.linspace(0, 0.5, 300)
    motion = replace(motion, trans=trans)
    ankles = [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]
    before, after = (
        reference_joints(m.poses, m.trans)[0][:, ankles] for m in (motion, lock_feet(motion))
    )
    moved = np.linalg.norm(after - before, axis=-1)
    assert 0.09 < moved.max() < MAX_SHIFT_M + 1e-6


def test_bones_and_the_direction_of_feet_are_kept():
    motion = crouching()
    locked = lock_feet(motion)
    before, turned = reference_joints(motion.poses, motion.trans)
    after, kept = reference_joints(locked.poses, locked.trans)
    np.testing.assert_allclose(after[:, [0, 1, 2, 15, 20]], before[:, [0, 1, 2, 15, 20]], atol=1e-9)
    ankles = [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]
    np.testing.assert_allclose(kept[:, ankles], turned[:, ankles], atol=1e-9)


def test_what_does_not_slide_is_left_alone():
    motion = crouching()
    still = replace(motion, trans=np.repeat(motion.trans[:1], len(motion), 0))
    np.testing.assert_allclose(lock_feet(still).poses, still.poses, atol=1e-5)


def test_a_foot_in_the_air_is_left_alone():
    motion = crouching()
    raised = replace(motion, trans=motion.trans + np.array([0, 0, 1.0]))
    assert not sole_rests(raised)[0].any()
    np.testing.assert_allclose(lock_feet(raised).poses, raised.poses, atol=1e-9)


@pytest.mark.parametrize("start_rad", [0.0, -0.08])
def test_a_straight_or_overstretched_knee_is_bent_back_not_forward(start_rad):
    poses = np.zeros((30, 72))
    poses[:, 0] = np.pi / 2
    poses[:, KNEE.start] = start_rad
    trans = np.zeros((30, 3))
    trans[:, 0] = 0.03 * np.sin(np.arange(30) / 5)
    motion = set_on_floor(Motion(poses, trans, 30.0, "", "", "a", "a"), feet=False, hands=False)
    lowered = replace(motion, trans=motion.trans - np.array([0, 0, 0.02]))
    locked = lock_feet(lowered)
    assert locked.poses[:, KNEE.start].min() > 0.05
    steps = Rotation.from_rotvec(locked.poses[:-1, KNEE]).inv() * Rotation.from_rotvec(
        locked.poses[1:, KNEE]
    )
    assert np.degrees(steps.magnitude()).max() < 5


def test_a_cycle_stays_without_a_seam():
    cycle = crouching(cycle=Cycle(0.0, np.zeros(2)))
    twice = loop_to(lock_feet(cycle), 120)
    steps = np.abs(np.diff(twice.poses, axis=0)).max(1)
    assert steps[59] < 1.5 * np.delete(steps, 59).max()
    assert floor_report(twice).sliding_mm_per_frame < 0.05


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_a_few_frames_are_enough(frames):
    assert len(lock_feet(crouching(frames))) == frames
