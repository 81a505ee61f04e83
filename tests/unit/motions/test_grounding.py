"""Motions set on the floor: standing, jumping, drifting, lying."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.frames import REST_POSE
from drapeline.motions.floor import floor_report, set_on_floor, touch_points
from drapeline.motions.motion import Cycle, loop_to
from toys.motion_files import standing_motion


@pytest.mark.parametrize("height", [-3.0, 0.9, 5.0])
def test_standing_ends_with_flat_soles_on_the_floor(height):
    motion = set_on_floor(standing_motion(height=height))
    lowest = touch_points(motion.poses, motion.trans)[..., 2].min(1)
    np.testing.assert_allclose(lowest, 0, atol=1e-9)
    # Heels and toes are level, so all sole points of both feet rest.
    resting = np.abs(touch_points(motion.poses, motion.trans)[0, :, 2]) < 1e-3
    assert resting.sum() == 8


def jumping(frames=90):
    """Stand, fly for 0.6 s in a parabola, stand."""
    motion = standing_motion(frames)
    time = np.clip((np.arange(frames) - 36) / 30, 0, 0.6)
    trans = motion.trans.copy()
    trans[:, 2] += 9.81 / 2 * time * (0.6 - time)
    return replace(motion, trans=trans)


def test_a_jump_keeps_its_height():
    raw = jumping()
    fitted = set_on_floor(raw)
    np.testing.assert_allclose(np.ptp(fitted.trans[:, 2]), np.ptp(raw.trans[:, 2]), atol=2e-3)
    lowest = touch_points(fitted.poses, fitted.trans)[..., 2].min(1)
    assert lowest.min() > -1e-9
    np.testing.assert_allclose(lowest[:30], 0, atol=5e-3)


def test_the_original_height_is_forgotten():
    low = set_on_floor(jumping())
    raw = jumping()
    high = set_on_floor(replace(raw, trans=raw.trans - [0, 0, -7.0]))
    np.testing.assert_allclose(low.trans, high.trans, atol=1e-9)


def test_drift_of_the_floor_is_removed_smoothly():
    motion = standing_motion(120)
    trans = motion.trans.copy()
    trans[:, 2] += np.linspace(0, 0.05, 120)  # a tilted capture floor
    fitted = set_on_floor(replace(motion, trans=trans))
    assert np.abs(np.diff(fitted.trans[:, 2], 2)).max() < 5e-4
    assert floor_report(fitted).floating_mean_mm < 3


def test_a_cycle_stays_without_a_seam():
    motion = replace(jumping(), cycle=Cycle(0.0, np.zeros(2)))
    motion = replace(motion, poses=motion.poses[20:], trans=motion.trans[20:])
    twice = loop_to(set_on_floor(motion), 140)
    assert abs(twice.trans[70, 2] - twice.trans[69, 2]) < 1e-3


def test_lying_rests_on_the_back():
    motion = standing_motion(30)
    poses = np.tile(REST_POSE, (30, 1))
    poses[:, :3] = 0.0  # face up
    lying = set_on_floor(replace(motion, poses=poses))
    assert 0.05 < lying.trans[0, 2] < 0.3


def test_one_frame_is_enough():
    fitted = set_on_floor(standing_motion(1))
    assert floor_report(fitted).penetration_max_mm < 1e-6
