"""Frame counts that are kept, and files that have changed."""

import os

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.motions import table
from drapeline.motions.motion import Motion, save_motion
from drapeline.motions.table import FrameCounts


def save(path, frames):
    poses, trans = np.repeat(REST_POSE[None], frames, 0), np.zeros((frames, 3))
    save_motion(path, Motion(poses, trans, 30.0, "stand", "", "clip", "clip"))


@pytest.fixture
def clip(tmp_path):
    save(tmp_path / "clip.npz", 20)
    return tmp_path / "clip.npz"


def test_a_clip_is_read_once_in_two_starts(clip, tmp_path, monkeypatch):
    first = FrameCounts(tmp_path / "kept/frames.json")
    assert first.count(str(clip), None) == 20
    first.remember()
    monkeypatch.setattr(table, "frame_count", None)
    assert FrameCounts(tmp_path / "kept/frames.json").count(str(clip), None) == 20


def test_a_clip_that_has_changed_is_read_anew(clip, tmp_path):
    first = FrameCounts(tmp_path / "frames.json")
    first.count(str(clip), None)
    first.remember()
    save(clip, 30)
    os.utime(clip, (1, 1))
    assert FrameCounts(tmp_path / "frames.json").count(str(clip), None) == 30
    assert FrameCounts(tmp_path / "frames.json").count(str(clip), 10) == 10


@pytest.mark.parametrize("text", ["", "[1]", '{"a": "b"}', "{"])
def test_a_damaged_memory_is_ignored(clip, tmp_path, text):
    (tmp_path / "frames.json").write_text(text)
    assert FrameCounts(tmp_path / "frames.json").count(str(clip), None) == 20


def test_a_missing_clip_is_named(tmp_path):
    with pytest.raises(InputError, match="none.npz: no such file"):
        FrameCounts().count(str(tmp_path / "none.npz"), None)
