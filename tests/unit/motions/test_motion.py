from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from drapeline.errors import InputError
from drapeline.motions.motion import (
    Cycle,
    Motion,
    check_motion,
    close_cycle,
    load_motion,
    loop_to,
    resample,
    resampled_count,
    save_motion,
    split,
    split_lengths,
)


def motion_of(poses, trans=None, fps=30.0, **changes):
    trans = np.zeros((len(poses), 3)) if trans is None else trans
    return Motion(poses, trans, fps, "walk", "12", "12_01.bvh", "12_01", **changes)


def random_motion(frames=40, fps=30.0, seed=0):
    rng = np.random.default_rng(seed)
    return motion_of(rng.uniform(-1, 1, (frames, 72)), rng.normal(size=(frames, 3)), fps)


@pytest.mark.parametrize("fps", [24.0, 60.0, 100.0, 119.88, 120.0])
def test_resampling_equals_scipys_slerp_joint_by_joint(fps):
    motion = random_motion(frames=31, fps=fps)
    result = resample(replace(motion, trans=motion.trans / fps))
    old, new = np.arange(31) / fps, np.arange(len(result)) / 30
    assert new[-1] <= old[-1] + 1e-9 < new[-1] + 1 / 30
    assert result.fps == 30
    for joint in range(24):
        columns = slice(3 * joint, 3 * joint + 3)
        twin = Slerp(old, Rotation.from_rotvec(motion.poses[:, columns]))(np.minimum(new, old[-1]))
        ours = Rotation.from_rotvec(result.poses[:, columns])
        assert (ours.inv() * twin).magnitude().max() < 1e-6


def test_a_steady_turn_and_walk_stay_exact():
    times = np.arange(121) / 120
    poses = np.zeros((121, 72))
    poses[:, 1] = 2.0 * times
    trans = times[:, None] * np.array([1.0, -2.0, 0.5])
    result = resample(motion_of(poses, trans, 120.0))
    np.testing.assert_allclose(result.poses[:, 1], 2.0 * np.arange(31) / 30, atol=1e-12)
    np.testing.assert_allclose(result.trans, trans[::4], atol=1e-12)


def test_resampling_goes_the_short_way_round():
    poses = np.zeros((2, 72))
    poses[:, 2] = np.radians([170, -170])
    result = resample(motion_of(poses, fps=15.0))
    np.testing.assert_allclose(np.abs(np.degrees(result.poses[1, 2])), 180, atol=1e-9)


@pytest.mark.parametrize(
    ("frames", "fps", "expected"), [(1, 120, 1), (121, 120, 31), (120, 120, 30), (3, 24, 3)]
)
def test_number_of_frames_after_resampling(frames, fps, expected):
    assert resampled_count(frames, fps) == expected
    assert (
        len(
            resample(
                random_motion(frames, float(fps)).__class__(
                    np.zeros((frames, 72)), np.zeros((frames, 3)), float(fps), "", "", "a", "a"
                )
            )
        )
        == expected
    )


def test_splits_are_named_and_hold_every_frame_once():
    motion = random_motion(700)
    parts = split(replace(motion, trans=motion.trans * 0.1))
    assert [part.sequence for part in parts] == ["12_01_s0", "12_01_s1", "12_01_s2"]
    assert [len(part) for part in parts] == [300, 300, 100] == split_lengths(700)
    np.testing.assert_array_equal(np.concatenate([part.poses for part in parts]), motion.poses)
    assert {(part.action, part.subject, part.source) for part in parts} == {
        ("walk", "12", "12_01.bvh")
    }


@pytest.mark.parametrize("frames", [1, 299, 300, 301, 600])
def test_no_split_is_empty_or_too_long(frames):
    lengths = split_lengths(frames)
    assert sum(lengths) == frames
    assert all(0 < length <= 300 for length in lengths)


def test_a_saved_motion_is_read_back_whole(tmp_path):
    motion = replace(random_motion(5, 30.0), cycle=Cycle(0.3, np.array([1.0, -2.0])))
    motion = replace(motion, trans=motion.trans * 0.01)
    save_motion(tmp_path / "m.npz", motion)
    back = load_motion(tmp_path / "m.npz")
    np.testing.assert_array_equal(back.poses, motion.poses)
    np.testing.assert_array_equal(back.trans, motion.trans)
    np.testing.assert_array_equal(back.cycle.shift_m, motion.cycle.shift_m)
    assert (back.fps, back.action, back.subject, back.source, back.sequence) == (
        30.0,
        "walk",
        "12",
        "12_01.bvh",
        "12_01",
    )
    assert back.cycle.turn_rad == 0.3
    assert back.reference_leg_length_m == motion.reference_leg_length_m


def with_value(array, index, value):
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.zeros((5, 69))}, r"poses of shape \(5, 69\), expected \(frames, 72\)"),
        ({"trans": np.zeros((4, 3))}, r"trans of shape \(4, 3\), expected \(5, 3\)"),
        ({"poses": np.zeros((0, 72)), "trans": np.zeros((0, 3))}, "holds 0 frames"),
        ({"fps": 0.0}, "0.0 frames per second"),
        ({"fps": np.nan}, "nan frames per second"),
        (
            {"poses": with_value(np.zeros((5, 72)), (3, 14), np.nan)},
            "frame 3, joint left_knee is nan, expected a finite angle",
        ),
        ({"trans": with_value(np.zeros((5, 3)), (2, 1), np.inf)}, "frame 2, root is at"),
        ({"trans": with_value(np.zeros((5, 3)), (2, 1), 90.0)}, "frame 1, the root moves at 2700"),
    ],
)
def test_unusable_motions_are_named(change, message):
    motion = replace(motion_of(np.zeros((5, 72))), **change)
    with pytest.raises(InputError, match=rf"12_01\.bvh: {message}"):
        check_motion(motion)


def test_an_npz_without_poses_is_refused(tmp_path):
    np.savez(tmp_path / "m.npz", trans=np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"m\.npz: lacks poses"):
        load_motion(tmp_path / "m.npz")


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
