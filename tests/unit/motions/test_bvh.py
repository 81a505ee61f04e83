from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import PARENTS
from drapeline.motions.bvh import bvh_frames, read_bvh
from drapeline.motions.joint_map import built_in_map
from drapeline.motions.skeleton import REFERENCE_OFFSETS, chain, globals_from_locals
from toys.motion_files import smooth_turns, write_bvh


@pytest.fixture
def walk(tmp_path):
    rng = np.random.default_rng(0)
    local = smooth_turns(rng, 20, 24, 0.5)
    return write_bvh(tmp_path / "walk.bvh", local, rng.normal(size=(20, 3))), local


def test_frame_zero_and_last_equal_what_was_written(walk):
    path, local = walk
    take = read_bvh(path)
    expected = globals_from_locals(PARENTS, local)
    order = [take.names.index(name) for name in take.names]
    assert len(take.rotations) == 20
    np.testing.assert_allclose(take.times_s, np.arange(20) / 30, atol=1e-6)
    # The file lists joints depth first, so compare by the positions they reach.
    positions = chain(PARENTS, expected, REFERENCE_OFFSETS[None])
    reached = take.positions - take.positions[:, :1]
    for joint in order:
        distance = np.linalg.norm(positions - reached[:, joint, None], axis=-1).min(1)
        np.testing.assert_allclose(distance, 0, atol=1e-6)


def test_single_channels_and_extra_joints_are_read(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text(
        "HIERARCHY\nROOT a\n{\n OFFSET 1 2 3\n CHANNELS 4 Yposition Xrotation Zposition Yrotation\n"
        " JOINT b\n {\n  OFFSET 0 5 0\n  CHANNELS 0\n  End Site\n  {\n   OFFSET 0 1 0\n  }\n }\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.01\n7 90 9 0\n"
    )
    take = read_bvh(path)
    np.testing.assert_allclose(take.positions[0, 0], [1, 7, 9])  # no Xposition: offset stays
    np.testing.assert_allclose(take.positions[0, 1], [1, 7, 14], atol=1e-12)


def test_a_leading_rest_pose_is_dropped(tmp_path, walk):
    _, local = walk
    stand = np.tile(np.eye(3), (1, 24, 1, 1))
    bent = local.copy()
    bent[:, 16] = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # an arm far from the T-pose
    path = write_bvh(tmp_path / "t.bvh", np.concatenate([stand, bent]), np.zeros((21, 3)))
    assert len(read_bvh(path).times_s) == 20
    assert bvh_frames(path)[0] == 20


def test_header_count_equals_the_whole_reading(walk):
    path, _ = walk
    count, fps = bvh_frames(path)
    assert count == len(read_bvh(path).times_s)
    assert fps == pytest.approx(30)


def edited(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HELLO", "does not start with 'HIERARCHY'"),
        ("MOTION", "", "no line 'MOTION'"),
        ("Frames: 20", "Frames: 0", "holds 0 frames, expected at least 1"),
        ("Frames: 20", "Frames: many", "'Frames: many', expected a number"),
        ("Frames: 20", "", "lacks 'Frames:'"),
        ("Frame Time: 0.033333333", "Frame Time: -1", "frame time -1.0"),
        ("Frames: 20", "Frames: 21", "1500 motion values, expected 21 frames of 75 channels, 1575"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Zrotator", "has channel 'Zrotator'"),
        ("OFFSET", "OFSET", "'OFSET' in the hierarchy"),
        ("JOINT LeftLeg", "JOINT LeftUpLeg", "LeftUpLeg appears twice"),
    ],
)
def test_malformed_files_are_named(walk, old, new, message):
    path = edited(walk[0], old, new)
    with pytest.raises(InputError, match=r"walk\.bvh: ") as caught:
        read_bvh(path)
    assert message in str(caught.value)


def test_nan_is_named_with_frame_and_joint(walk):
    path, _ = walk
    lines = path.read_text().splitlines()
    values = lines[-3].split()
    values[6] = "nan"
    lines[-3] = " ".join(values)
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="frame 17, joint LeftUpLeg holds nan"):
        read_bvh(path)


def test_text_in_place_of_numbers_is_refused(walk):
    path, _ = walk
    path.write_text(path.read_text() + "oops\n")
    with pytest.raises(InputError, match=r"walk\.bvh: .*'oops'"):
        read_bvh(path)


@pytest.mark.parametrize("keep", [0.2, 0.7])
def test_a_file_cut_off_is_refused(walk, keep):
    path, _ = walk
    text = path.read_text()
    path.write_text(text[: int(len(text) * keep)])
    with pytest.raises(InputError, match=r"walk\.bvh: "):
        read_bvh(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.bvh: no such file"):
        read_bvh(tmp_path / "none.bvh")


def test_unknown_joints_are_listed_with_what_to_write(walk):
    path = edited(walk[0], "JOINT LeftUpLeg", "JOINT Oberschenkel")
    take = read_bvh(path)
    shapeless = replace(take, offsets=np.zeros_like(take.offsets))
    with pytest.raises(InputError, match="Oberschenkel.*'joint_map' YAML"):
        built_in_map(shapeless)


def test_a_count_that_the_file_cannot_hold_is_refused_from_the_header(walk):
    path, _ = walk
    path.write_text(path.read_text().replace("Frames: 20", "Frames: 200000000"))
    with pytest.raises(
        InputError, match=r"walk\.bvh: \d+ bytes, expected more for 200000000 frames"
    ):
        bvh_frames(path)
    with pytest.raises(InputError, match=r"walk\.bvh: holds \d+ motion values, expected 200000000"):
        read_bvh(path)


def test_a_skeleton_that_does_not_move_is_refused(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text(
        "HIERARCHY\nROOT a\n{\n OFFSET 1 2 3\n CHANNELS 0\n}\n"
        "MOTION\nFrames: 100000000000\nFrame Time: 0.01\n"
    )
    with pytest.raises(InputError, match=r"a\.bvh: has no channels"):
        bvh_frames(path)


def test_a_byte_order_mark_and_names_in_any_language_are_read(walk):
    path, _ = walk
    expected = read_bvh(path)
    text = path.read_text().replace("LeftArm", "左腕").replace("LeftLeg", "Bip01 Left Leg")
    for marked in (b"", b"\xef\xbb\xbf"):
        path.write_bytes(marked + text.encode())
        take = read_bvh(path)
        assert {"左腕", "Bip01 Left Leg"} <= set(take.names)
        np.testing.assert_array_equal(take.positions, expected.positions)
        assert bvh_frames(path)[0] == 20


def test_names_of_older_programs_are_read(walk):
    path, _ = walk
    path.write_bytes(path.read_text().replace("LeftArm", "Fuß").encode("latin-1"))
    assert "Fuß" in read_bvh(path).names


def braces(text):
    head = text.split("MOTION")[0]
    return [at for at, letter in enumerate(head) if letter in "{}"]


@pytest.mark.parametrize("repeat", [0, 2])
def test_any_brace_dropped_or_doubled_is_refused_with_a_line(walk, repeat):
    path, _ = walk
    text = path.read_text()
    for at in braces(text):
        path.write_text(text[:at] + repeat * text[at] + text[at + 1 :])
        for read in (read_bvh, bvh_frames):
            with pytest.raises(InputError, match=r"walk\.bvh: line \d+: "):
                read(path)


def test_a_brace_that_is_missing_at_its_start_is_found_in_its_line(walk):
    path = edited(walk[0], "\t{", "\t")
    with pytest.raises(InputError, match=r"walk\.bvh: line 8: 'OFFSET', expected '{'"):
        read_bvh(path)


@pytest.mark.parametrize(
    ("written", "fps"),
    [
        *(("0.0333333", 30), ("0.033333", 30), (".0333", 30), ("0.033", 30), ("3.333e-2", 30)),
        *(("0.008333", 120), ("0.00833", 120), ("0.0083", 120), ("0.016667", 60), ("0.01666", 60)),
        *(("0.033367", 30 / 1.001), ("0.0166833", 60 / 1.001), ("0.041667", 24)),
        *(("0.01", 100), ("0.04", 25), ("0.0078125", 128), ("0.0345", 1 / 0.0345)),
    ],
)
def test_rates_that_are_rounded_are_the_rates_that_people_mean(walk, written, fps):
    path = edited(walk[0], "0.033333333", written)
    assert bvh_frames(path)[1] == pytest.approx(fps, rel=1e-12)
    np.testing.assert_allclose(read_bvh(path).times_s, np.arange(20) / fps, rtol=1e-12)
