import csv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.clips import CLIPS, INSIDE_WHEEL, write_clips
from drapeline.motions.floor import floor_report
from drapeline.motions.importing import frame_count, import_motion
from drapeline.motions.motion import load_motion
from toys.motion_files import deepmimic_frame, write_deepmimic

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
