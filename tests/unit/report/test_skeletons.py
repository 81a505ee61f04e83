import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.importing import read_take
from drapeline.motions.joint_map import JointMap
from drapeline.motions.skeleton import REFERENCE_OFFSETS, Take, chain, globals_from_locals
from drapeline.report.skeletons import plot_skeleton

CALLED = {joint: f"node {k}" for k, joint in enumerate(JOINT_NAMES)}


@pytest.fixture
def take():
    """Somebody who bows, stands, and bows again."""
    turns = np.tile(np.eye(3), (3, 24, 1, 1))
    bow = Rotation.from_euler("x", 80, degrees=True).as_matrix()
    turns[[0, 2], JOINT_NAMES.index("spine1")] = bow
    rotations = globals_from_locals(PARENTS, turns)
    positions = chain(PARENTS, rotations, REFERENCE_OFFSETS[None])
    names = tuple(CALLED.values())
    times = np.arange(3) / 30
    return Take("a/strange.bvh", names, PARENTS, REFERENCE_OFFSETS, rotations, positions, times)


def test_every_joint_is_drawn_with_both_names(take, tmp_path):
    plot_skeleton(tmp_path / "a.svg", take, JointMap("found by shape", CALLED))
    drawn = (tmp_path / "a.svg").read_text()
    for joint, name in CALLED.items():
        assert f"{joint}: {name}<" in drawn
    assert "strange.bvh: 24 joints of 24<" in drawn


def test_joints_that_nothing_drives_are_named(take, tmp_path):
    known = {joint: name for joint, name in CALLED.items() if not joint.endswith("hand")}
    plot_skeleton(tmp_path / "a.svg", take, JointMap("mine", known))
    drawn = (tmp_path / "a.svg").read_text()
    assert "strange.bvh: 22 joints of 24, none for left_hand, right_hand<" in drawn
    assert "left_hand: " not in drawn


def test_the_straightest_frame_is_drawn(take, tmp_path):
    """Frames that bow say nothing: without them the same picture comes out."""
    plot_skeleton(tmp_path / "all.svg", take, JointMap("mine", CALLED))
    upright = Take(
        *(take.source, take.names, take.parents, take.offsets),
        *(take.rotations[1:2], take.positions[1:2], take.times_s[1:2]),
    )
    plot_skeleton(tmp_path / "upright.svg", upright, JointMap("mine", CALLED))
    assert (tmp_path / "all.svg").read_text() == (tmp_path / "upright.svg").read_text()


def test_poses_without_a_skeleton_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", poses=np.zeros((4, 72)), trans=np.zeros((4, 3)), fps=30.0)
    with pytest.raises(InputError, match=r"a\.npz: holds SMPL poses, expected a file with a sk"):
        read_take(tmp_path / "a.npz")
