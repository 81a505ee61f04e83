import csv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from make_clips import (
    CLIPS,
    INSIDE_WHEEL,
    read_deepmimic,
    steady_upper_arms,
    write_clips,
)
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.floor import floor_report
from drapeline.motions.importing import frame_count, import_motion
from drapeline.motions.joint_map import BUILT_IN, load_joint_map
from drapeline.motions.motion import load_motion
from drapeline.motions.retarget import retarget
from drapeline.motions.skeleton import reference_joints
from toys.motion_files import deepmimic_frame, write_deepmimic


def joints_of(path):
    take, _ = read_deepmimic(path)
    poses, trans = retarget(take, load_joint_map(BUILT_IN / "deepmimic.yaml"))
    joints, _ = reference_joints(poses, trans)
    return {name: joints[0, index] for index, name in enumerate(JOINT_NAMES)}


def direction(place, start, end):
    vector = place[end] - place[start]
    return vector / np.linalg.norm(vector)


def test_zero_angles_stand_with_hanging_arms(tmp_path):
    place = joints_of(write_deepmimic(tmp_path / "a.txt", [deepmimic_frame(), deepmimic_frame()]))
    for side in ("left", "right"):
        for start, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee")):
            found = direction(place, f"{side}_{start}", f"{side}_{end}")
            np.testing.assert_allclose(found, [0, 0, -1], atol=1e-6)
    assert place["left_hip"][0] > 0 > place["right_hip"][0]
    assert place["left_foot"][1] < place["left_ankle"][1]  # toes ahead, towards -Y


def test_knees_bend_back_and_elbows_forward_on_their_own_side(tmp_path):
    bent = deepmimic_frame(right_knee=-1.2, left_elbow=1.0)
    place = joints_of(write_deepmimic(tmp_path / "a.txt", [bent, bent]))
    shin = direction(place, "right_knee", "right_ankle")
    np.testing.assert_allclose(shin, [0, np.sin(1.2), -np.cos(1.2)], atol=1e-6)
    np.testing.assert_allclose(direction(place, "left_knee", "left_ankle"), [0, 0, -1], atol=1e-6)
    forearm = direction(place, "left_elbow", "left_wrist")
    np.testing.assert_allclose(forearm, [0, -np.sin(1.0), -np.cos(1.0)], atol=1e-6)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], "frames of shape"),
        ([[1, 2, 3]] * 3, r"frames of shape \(3, 3\)"),
        (
            [deepmimic_frame(), deepmimic_frame(left_knee=float("nan"))],
            "not readable as JSON .NaN is no number of JSON",
        ),
        ([deepmimic_frame(), [1.0]], "not readable as a DeepMimic clip"),
    ],
)
def test_malformed_clips_are_named(tmp_path, frames, message):
    with pytest.raises(InputError, match=rf"a\.txt: {message}"):
        read_deepmimic(write_deepmimic(tmp_path / "a.txt", frames))


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


SHIPPED = Path(__file__).parents[3] / "workflow" / "resources" / "motions"


def test_every_clip_of_a_wheel_is_converted_and_listed(tmp_path):
    swing = [deepmimic_frame(x=0.02 * k, left_elbow=0.5 + 0.4 * np.sin(k / 5)) for k in range(64)]
    text = write_deepmimic(tmp_path / "clip.txt", swing, loop="wrap").read_text()
    with zipfile.ZipFile(tmp_path / "pybullet.whl", "w") as wheel:
        for entry in CLIPS:
            wheel.writestr(INSIDE_WHEEL.format(name=entry.name), text)
    lines = write_clips(tmp_path / "pybullet.whl", tmp_path / "out")
    assert (tmp_path / "out" / "clips.tsv").read_text().splitlines() == lines
    assert len(lines) == len(CLIPS) + 1
    motion = load_motion(tmp_path / "out" / "walk.npz")
    np.testing.assert_allclose(motion.cycle.shift_m[1], -63 * 0.02 * 0.82 / 0.831416, atol=1e-4)


def test_a_wheel_without_clips_is_named(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.whl", "w") as wheel:
        wheel.writestr("a.txt", "")
    with pytest.raises(InputError, match=r"other\.whl: not a pybullet wheel"):
        write_clips(tmp_path / "other.whl", tmp_path / "out")


def shipped():
    with open(SHIPPED / "clips.tsv", newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))


@pytest.mark.parametrize("row", shipped(), ids=lambda row: row["name"])
def test_shipped_clips_are_sound(row):
    path = SHIPPED / row["file"]
    motion = import_motion(path, frames=90)
    assert frame_count(path) == int(row["frames"])
    assert len(motion) == (90 if row["loop"] == "yes" else min(int(row["frames"]), 90))
    assert floor_report(motion).penetration_max_mm < 1e-6
    local = motion.poses.reshape(-1, 24, 3)
    for side, sign in (("left", 1), ("right", -1)):
        knee, elbow = (local[:, JOINT_NAMES.index(f"{side}_{part}")] for part in ("knee", "elbow"))
        assert knee[:, 0].min() > np.radians(-15)  # shins go back
        assert (sign * elbow[:, 1]).max() < np.radians(15)  # forearms come forward
    step = Rotation.from_rotvec(motion.poses[:-1].reshape(-1, 3)).inv() * Rotation.from_rotvec(
        motion.poses[1:].reshape(-1, 3)
    )
    assert np.degrees(step.magnitude()).max() < 75  # no jump, even at a seam
    assert len(PARENTS) == local.shape[1]


@pytest.mark.parametrize(("name", "speed_m_s"), [("walk", 0.9), ("run", 3.3)])
def test_shipped_walks_go_where_they_face(name, speed_m_s):
    motion = import_motion(SHIPPED / f"{name}.npz", frames=120)
    front = Rotation.from_rotvec(motion.poses[:, :3]).apply([0, 0, 1])[:, :2].mean(0)
    travel = (motion.trans[-1] - motion.trans[0])[:2] / (119 / 30)
    assert travel @ front / np.linalg.norm(front) == pytest.approx(speed_m_s, rel=0.15)
