"""The humanoid3d format of DeepMimic."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.motions.deepmimic import read_deepmimic
from drapeline.motions.joint_map import BUILT_IN, load_joint_map
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
