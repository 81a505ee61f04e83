import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.motions.amass import read_amass
from drapeline.motions.importing import frame_count, import_motion


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
