import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.motions.looping import close_cycle, loop_to
from drapeline.motions.motion import Cycle, Motion


def round_of(mismatch_rad=0.0, turn_rad=0.4, seconds=1.0, rate=60.0):
    """A swing of one joint while walking on an arc; the last frame is the first, moved on."""
    times = np.arange(int(seconds * rate) + 1) / rate
    phase = times / times[-1]
    poses = np.zeros((len(times), 72))
    lean = Rotation.from_rotvec([np.pi / 2, 0, 0])
    heading = Rotation.from_rotvec(phase[:, None] * [0, 0, turn_rad])
    poses[:, :3] = (heading * lean).as_rotvec()
    poses[:, 5] = 0.5 * np.sin(2 * np.pi * phase) + mismatch_rad * phase
    along = np.stack([np.sin(phase * turn_rad), -np.cos(phase * turn_rad)], axis=1)
    trans = np.concatenate([2.0 * along, 0.9 + 0.02 * np.cos(2 * np.pi * phase)[:, None]], axis=1)
    return poses, trans, times


def as_motion(poses, trans, cycle):
    return Motion(poses, trans, 30.0, "", "", "a", "a", cycle=cycle)


def steps_deg(poses):
    turns = Rotation.from_rotvec(poses.reshape(-1, 3))
    count = len(poses)
    quats = turns.as_quat().reshape(count, 24, 4)
    dots = np.abs((quats[1:] * quats[:-1]).sum(-1)).clip(0, 1)
    return np.degrees(2 * np.arccos(dots))


def test_an_exact_cycle_is_left_alone():
    poses, trans, times = round_of()
    looped, path, cycle = close_cycle(poses, trans, times, fps=30)
    assert cycle.turn_rad == pytest.approx(0.4)
    np.testing.assert_allclose(looped, poses[:-1:2], atol=1e-9)
    np.testing.assert_allclose(path, trans[:-1:2], atol=1e-9)


def test_rounds_follow_the_same_arc_for_ever():
    poses, trans, times = round_of(turn_rad=np.pi / 2)
    motion = as_motion(*close_cycle(poses, trans, times, fps=30))
    four = loop_to(motion, 4 * len(motion) + 1)
    assert len(four) == 121
    np.testing.assert_allclose(four.trans[-1], four.trans[0], atol=1e-9)  # a whole circle
    np.testing.assert_allclose(np.linalg.norm(four.trans[:, :2], axis=1), 2.0, atol=1e-3)
    assert (steps_deg(four.poses)[:, 0]).std() < 1e-6  # steady turning through the seams


def test_a_mismatch_is_blended_without_a_jump():
    poses, trans, times = round_of(mismatch_rad=0.5)
    motion = as_motion(*close_cycle(poses, trans, times, fps=30))
    long = loop_to(motion, 90)
    steps = steps_deg(long.poses)[:, 1]
    assert steps[29] < 1.2 * steps[:29].max()
    assert steps[59] == pytest.approx(steps[29], abs=1e-6)


def test_a_straight_cycle_does_not_turn():
    poses, trans, times = round_of(turn_rad=0.1)
    _, _, cycle = close_cycle(poses, trans, times, fps=30, straight=True)
    assert cycle.turn_rad == 0.0


@pytest.mark.parametrize("frames", [1, 29, 30, 31, 100])
def test_the_asked_number_of_frames_is_given(frames):
    poses, trans, times = round_of()
    motion = as_motion(*close_cycle(poses, trans, times, fps=30))
    assert len(loop_to(motion, frames)) == frames


def test_a_motion_that_is_no_cycle_stays_as_it_is():
    motion = as_motion(np.zeros((5, 72)), np.zeros((5, 3)), None)
    assert loop_to(motion, 50) is motion


def test_the_displacement_accumulates():
    poses = np.zeros((10, 72))
    motion = as_motion(poses, np.zeros((10, 3)), Cycle(0.0, np.array([0.0, -1.5])))
    np.testing.assert_allclose(loop_to(motion, 25).trans[[0, 10, 20], 1], [0, -1.5, -3.0])
