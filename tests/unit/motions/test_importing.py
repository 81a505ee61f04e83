from dataclasses import replace

import numpy as np
import pytest
import yaml

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.motions.bvh import read_bvh
from drapeline.motions.floor import floor_report
from drapeline.motions.importing import frame_count, import_motion, read_amass
from drapeline.motions.joint_map import built_in_map
from drapeline.motions.motion import Cycle, Motion, save_motion
from drapeline.motions.retarget import retarget
from toys.motion_files import SMPL_TO_CMU_BVH, smooth_turns, write_bvh


def saved(path, frames=10, size=156, **changes):
    rng = np.random.default_rng(0)
    arrays = {
        "poses": rng.uniform(-1, 1, (frames, size)),
        "trans": rng.normal(scale=0.01, size=(frames, 3)),
        "mocap_framerate": 120.0,
        "gender": "male",
        "betas": np.zeros(16),
    } | changes
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path, arrays


@pytest.mark.parametrize("size", [72, 156, 165])
def test_body_joints_are_taken_as_they_are(tmp_path, size):
    path, arrays = saved(tmp_path / "a.npz", size=size)
    motion = read_amass(path)
    kept = 72 if size == 72 else 66
    np.testing.assert_array_equal(motion.poses[:, :kept], arrays["poses"][:, :kept])
    assert not motion.poses[:, kept:].any()
    assert motion.fps == 120


def test_the_path_is_that_of_the_root_joint_up_to_a_constant(tmp_path):
    path, arrays = saved(tmp_path / "a.npz")
    motion = read_amass(path)
    moved = np.diff(motion.trans, axis=0) / np.diff(arrays["trans"], axis=0)
    np.testing.assert_allclose(moved, motion.reference_leg_length_m / 0.79)


def test_the_newer_frame_rate_key_is_known(tmp_path):
    path, _ = saved(tmp_path / "a.npz", mocap_framerate=None, mocap_frame_rate=60.0)
    assert read_amass(path).fps == 60


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": np.zeros((10, 63))}, r"poses of shape \(10, 63\), expected .* 156 \(SMPL-H\)"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "holds 0 frames"),
        ({"poses": np.full((10, 156), np.nan)}, "frame 0, joint pelvis is nan"),
        ({"trans": np.zeros((9, 3))}, r"trans of shape \(9, 3\), expected \(10, 3\)"),
        ({"trans": None}, "lacks trans"),
        ({"mocap_framerate": None}, "has no frame rate, expected one of mocap_framerate"),
        ({"mocap_framerate": 0.0}, "0.0 frames per second"),
    ],
)
def test_unusable_files_are_named(tmp_path, changes, message):
    path, _ = saved(tmp_path / "a.npz", **changes)
    with pytest.raises(InputError, match=rf"a\.npz: {message}"):
        read_amass(path)


def test_stage_two_files_are_read_without_their_pickled_markers(tmp_path):
    """Keys as in AMASS's SMPL-X release, whose `markers_latent_vids` is a dict."""
    touched = tmp_path / "touched"
    path, arrays = saved(
        tmp_path / "walk_stageii.npz",
        size=165,
        mocap_framerate=None,
        mocap_frame_rate=120.0,
        surface_model_type="smplx",
        markers_latent=np.zeros((53, 3)),
        markers_latent_vids=np.array({"C7": 3832}, dtype=object),
        latent_labels=np.array(["C7", Touch(touched)], dtype=object),
    )
    motion = read_amass(path)
    np.testing.assert_array_equal(motion.poses[:, :66], arrays["poses"][:, :66])
    assert len(import_motion(path)) == frame_count(path) == 3
    assert not touched.exists()


class Touch:
    """Leaves a trace if it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


def test_pickles_inside_are_not_run(tmp_path):
    np.savez(tmp_path / "a.npz", poses=np.array([{"a": 1}], dtype=object), trans=np.zeros((1, 3)))
    with pytest.raises(InputError, match=r"a\.npz: 'poses' holds Python objects"):
        read_amass(tmp_path / "a.npz")


LEG = ("hip", "knee", "ankle")


@pytest.fixture
def make(tmp_path):
    """One motion file of each kind, 50 frames at 60 fps or as many as its kind allows."""
    rng = np.random.default_rng(0)
    local = smooth_turns(rng, 50, 24, 0.3)
    root = np.linspace([0, 0.9, 0], [0, 0.9, 1.0], 50)

    def bvh():
        return write_bvh(tmp_path / "12_03.bvh", local, root, frame_time=1 / 60)

    def amass():
        poses = rng.uniform(-0.1, 0.1, (50, 156))
        poses[:, 0] += np.pi / 2
        trans = np.zeros((50, 3))
        np.savez(tmp_path / "a.npz", poses=poses, trans=trans, mocap_framerate=60.0)
        return tmp_path / "a.npz"

    def cycle():
        poses = np.zeros((20, 72))
        poses[:, 0] = np.pi / 2
        motion = Motion(
            poses,
            np.tile([0, 0, 0.9], (20, 1)),
            30.0,
            "walk",
            "me",
            "x.txt",
            "x",
            cycle=Cycle(0.1, np.array([0.0, -0.1])),
        )
        save_motion(tmp_path / "cycle.npz", motion)
        return tmp_path / "cycle.npz"

    return {"bvh": bvh, "amass": amass, "cycle": cycle}


@pytest.mark.parametrize("kind", ["bvh", "amass", "cycle"])
@pytest.mark.parametrize("frames", [None, 7, 100])
def test_the_count_is_known_before_reading(make, kind, frames):
    path = make[kind]()
    motion = import_motion(path, frames=frames)
    assert frame_count(path, frames=frames) == len(motion)
    assert motion.fps == 30
    whole = 20 if kind == "cycle" else 25
    longest = 100 if kind == "cycle" else 25
    assert len(motion) == {None: whole, 7: 7, 100: longest}[frames]


@pytest.mark.parametrize("kind", ["bvh", "amass", "cycle"])
def test_a_part_of_a_file_is_that_part_of_the_motion(make, kind):
    path = make[kind]()
    whole = import_motion(path, lock_feet=False)
    part = import_motion(path, start_s=0.2, end_s=0.5, lock_feet=False)
    assert len(part) == frame_count(path, start_s=0.2, end_s=0.5) == 9
    np.testing.assert_allclose(part.poses, whole.poses[6:15], atol=1e-6)
    np.testing.assert_allclose(
        np.diff(part.trans, axis=0), np.diff(whole.trans[6:15], axis=0), atol=1e-6
    )


def test_labels_are_kept_or_replaced(make):
    path = make["cycle"]()
    motion = import_motion(path)
    assert (motion.action, motion.subject, motion.source, motion.sequence) == (
        "walk",
        "me",
        "x.txt",
        "x",
    )
    motion = import_motion(path, action="stroll", subject="you", sequence="s")
    assert (motion.action, motion.subject, motion.sequence) == ("stroll", "you", "s")
    motion = import_motion(make["bvh"]())
    assert (motion.subject, motion.source, motion.sequence) == ("12", "12_03.bvh", "12_03")


@pytest.mark.parametrize("kind", ["bvh", "amass"])
def test_imported_motions_stand_on_the_floor(make, kind):
    assert floor_report(import_motion(make[kind]())).penetration_max_mm < 1e-6


def test_without_locked_feet_legs_bend_as_in_the_file(tmp_path):
    local = smooth_turns(np.random.default_rng(0), 50, 24, 0.02)
    root = np.linspace([0, 0.9, 0], [0, 0.9, 0.08], 50)  # someone stands, but slides
    path = write_bvh(tmp_path / "a.bvh", local, root, frame_time=1 / 60)
    legs = [JOINT_NAMES.index(f"{side}_{part}") for side in ("left", "right") for part in LEG]
    locked, free = (import_motion(path, lock_feet=lock).poses for lock in (True, False))
    take = read_bvh(path)
    captured, _ = retarget(take, built_in_map(take))
    assert floor_report(import_motion(path, lock_feet=False)).penetration_max_mm < 1e-6
    # Every second frame of the file; the others are dropped.
    captured, free, locked = (x.reshape(len(x), 24, 3)[:, legs] for x in (captured, free, locked))
    np.testing.assert_allclose(free, captured[::2], atol=1e-6)
    assert np.abs(locked - free).max() > 0.01


def test_a_joint_map_opens_any_skeleton(make, tmp_path):
    path = make["bvh"]()
    expected = import_motion(path)
    text = path.read_text()
    for name in SMPL_TO_CMU_BVH.values():
        text = text.replace(f" {name}\n", f" my{name}\n")
    path.write_text(text)
    joints = {j: f"my{SMPL_TO_CMU_BVH[j]}" for j in JOINT_NAMES if "hand" not in j}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"joints": joints}))
    motion = import_motion(path, joint_map=tmp_path / "map.yaml")
    np.testing.assert_allclose(motion.poses, expected.poses, atol=1e-9)


@pytest.mark.parametrize("read", [import_motion, frame_count])
@pytest.mark.parametrize("name", ["a.c3d", "missing.bvh", "missing.npz", "missing.amc"])
def test_missing_and_unknown_files_are_named(tmp_path, read, name):
    if name.endswith(".c3d"):
        (tmp_path / name).write_text("")
    with pytest.raises(InputError, match=rf"{name}: .*expected"):
        read(tmp_path / name)


@pytest.mark.parametrize("read", [import_motion, frame_count])
@pytest.mark.parametrize("suffix", [".npz", ".bvh", ".amc"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x01 not a motion", b"PK\x03\x04 cut"])
def test_unreadable_files_are_named(tmp_path, read, suffix, content):
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    (tmp_path / "bad.asf").write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.a?\w+: "):
        read(path)


def test_npz_headers_without_frames_or_rate_are_named(tmp_path):
    np.savez(tmp_path / "a.npz", poses=np.zeros((0, 156)), mocap_framerate=60.0)
    with pytest.raises(InputError, match=r"a\.npz: poses of shape \(0, 156\)"):
        frame_count(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", poses=np.zeros((5, 156)))
    with pytest.raises(InputError, match=r"b\.npz: has no frame rate"):
        frame_count(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", x=np.zeros(5))
    with pytest.raises(InputError, match=r"c\.npz: lacks poses; it holds x"):
        frame_count(tmp_path / "c.npz")


def test_nan_in_our_own_file_names_it(make):
    path = make["cycle"]()
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["poses"][4, 30] = np.nan
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=r"cycle\.npz: frame 4, joint left_foot is nan"):
        import_motion(path)


def test_one_frame_of_bvh_is_a_motion(tmp_path):
    still = np.tile(np.eye(3), (1, 24, 1, 1))
    path = write_bvh(tmp_path / "one.bvh", still, np.zeros((1, 3)))
    motion = import_motion(path)
    assert len(motion) == 1 == frame_count(path)
    assert replace(motion, source="").sequence == "one"


@pytest.mark.parametrize("fps", [1e-9, 1e12])
def test_rates_of_no_recording_are_refused(tmp_path, fps):
    path = tmp_path / "a.npz"
    np.savez(path, poses=np.zeros((5, 156)), trans=np.zeros((5, 3)), mocap_framerate=fps)
    for read in (frame_count, import_motion):
        with pytest.raises(InputError, match=r"a\.npz: .* frames per second, expected 1 to 10000"):
            read(path)
