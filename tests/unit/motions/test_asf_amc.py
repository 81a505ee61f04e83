import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.motions.asf_amc import amc_frames, find_asf, read_asf_amc
from drapeline.motions.joint_map import built_in_map
from drapeline.motions.retarget import retarget
from drapeline.motions.skeleton import reference_joints
from toys.motion_files import amc_text, asf_text


@pytest.fixture
def files(tmp_path):
    def write(*frames):
        asf, amc = tmp_path / "07.asf", tmp_path / "07_01.amc"
        asf.write_text(asf_text())
        amc.write_text(amc_text(frames))
        return asf, amc

    return write


def directions(asf, amc):
    take = read_asf_amc(asf, amc)
    poses, trans = retarget(take, built_in_map(take))
    joints, _ = reference_joints(poses, trans)

    def bone(start, end):
        vector = joints[0, JOINT_NAMES.index(end)] - joints[0, JOINT_NAMES.index(start)]
        return vector / np.linalg.norm(vector)

    return bone


def test_zero_angles_show_the_skeletons_rest_pose(files):
    bone = directions(*files({}))
    slant = np.radians(20)
    np.testing.assert_allclose(
        bone("left_knee", "left_ankle"), [np.sin(slant), 0, -np.cos(slant)], atol=1e-5
    )
    np.testing.assert_allclose(bone("right_elbow", "right_wrist"), [-1, 0, 0], atol=1e-6)


def test_a_knee_bends_back_about_the_bones_own_axis(files):
    bone = directions(*files({"ltibia": [90]}))
    np.testing.assert_allclose(bone("left_knee", "left_ankle"), [0, 1, 0], atol=1e-5)
    np.testing.assert_allclose(bone("right_knee", "right_ankle")[1], 0, atol=1e-5)


@pytest.mark.parametrize(("side", "sign"), [("left", -1), ("right", 1)])
def test_an_elbow_bends_about_smpls_own_hinge(files, side, sign):
    take = read_asf_amc(*files({f"{side[0]}radius": [70]}))
    poses, _ = retarget(take, built_in_map(take))
    elbow = np.degrees(poses.reshape(24, 3)[JOINT_NAMES.index(f"{side}_elbow")])
    np.testing.assert_allclose(elbow, [0, 70 * sign, 0], atol=1e-5)


def test_axes_are_applied_in_the_order_written(files):
    # Own axes of the humerus: C = Rz Ry Rx; turning by rz then means C Rz(a) C^-1.
    own = Rotation.from_euler("xyz", [180, -30, -90], degrees=True)
    turn = own * Rotation.from_euler("xyz", [20, -35, 50], degrees=True) * own.inv()
    bone = directions(*files({"lhumerus": [20, -35, 50]}))
    x, y, z = turn.apply([1, 0, 0])
    np.testing.assert_allclose(bone("left_shoulder", "left_elbow"), [x, -z, y], atol=1e-6)


def test_the_root_carries_heading_and_path(files):
    asf, amc = files({"root": [0, 17, 0, 0, 90, 0]}, {"root": [10, 17, 0, 0, 90, 0]})
    take = read_asf_amc(asf, amc)
    poses, trans = retarget(take, built_in_map(take))
    front = Rotation.from_rotvec(poses[0, :3]).apply([0, 0, 1])
    np.testing.assert_allclose(front, [1, 0, 0], atol=1e-9)
    # 10 units of 1/0.45 inches, brought to the reference skeleton by its 0.82 m of 14.7 units.
    np.testing.assert_allclose(trans[1] - trans[0], [10 * 0.82 / 14.7, 0, 0], atol=1e-9)


def test_frames_are_counted_from_the_ends(files):
    _, amc = files(*[{}] * 37)
    assert amc_frames(amc) == 37


def test_the_skeleton_beside_a_motion_is_found(files, tmp_path):
    asf, amc = files({})
    (tmp_path / "99.asf").write_text("")
    assert find_asf(amc) == asf
    with pytest.raises(InputError, match=r"08_01\.amc: no 08\.asf beside it"):
        find_asf(tmp_path / "08_01.amc")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lfemur 0 0 0", "lfemur 0 0", "frame 1, bone lfemur holds 0 0, expected 3 finite"),
        ("lfemur 0 0 0", "lfemur 0 nan 0", "frame 1, bone lfemur holds 0 nan 0"),
        ("lfemur 0 0 0", "lfemur 0 x 0", "frame 1, bone lfemur: could not convert"),
        ("lfemur 0 0 0", "tail 0 0 0", "frame 1 moves bone tail, expected one of root"),
        ("lfemur 0 0 0\n", "", "bone lfemur has 0 values in 1 frames"),
    ],
)
def test_malformed_motions_are_named(files, old, new, message):
    asf, amc = files({})
    amc.write_text(amc.read_text().replace(old, new))
    with pytest.raises(InputError, match=r"07_01\.amc: ") as caught:
        read_asf_amc(asf, amc)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [("name ltibia", "name lshin"), ("length 7.2", "length long"), (":hierarchy", ":nothing")],
)
def test_malformed_skeletons_are_named(files, old, new):
    asf, amc = files({})
    asf.write_text(asf.read_text().replace(old, new))
    with pytest.raises(InputError, match=r"07\.asf: "):
        read_asf_amc(asf, amc)


def test_no_frames_and_no_file(files, tmp_path):
    asf, amc = files()
    with pytest.raises(InputError, match="holds 0 frames"):
        read_asf_amc(asf, amc)
    with pytest.raises(InputError, match="holds 0 frames"):
        amc_frames(amc)
    with pytest.raises(InputError, match=r"none\.amc: no such file"):
        read_asf_amc(asf, tmp_path / "none.amc")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("root lowerback", "root lowerback\nhead root", "disagree on root"),
        ("root lowerback", "toes lowerback", "disagree on toes"),
        ("axis 0 0 0 XYZ", "axis 0 0 0 XYW", "not readable as ASF"),
        ("axis 0 0 0 XYZ", "axis 0 1e300 0 XYZ", "angles '0 1e300 0', expected finite numbers"),
        ("dof rx ry rz", "dof rx ry rq", "moves in rx ry rq, expected some of"),
        ("length 2", "length nan", "has no direction and length"),
        ("direction 0 1 0", "direction 0 1", "has no direction and length"),
    ],
)
def test_skeletons_that_are_none_are_refused(files, old, new, message):
    asf, amc = files({})
    asf.write_text(asf.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=rf"07\.asf: .*({message})"):
        read_asf_amc(asf, amc)


@pytest.mark.parametrize("numbers", [(1, 999999999), (1, 0), (1, 1), (4, 8, 12), (1, 3)])
def test_frames_that_skip_or_repeat_are_refused_by_count_and_by_reading(files, numbers):
    asf, amc = files(*[{}] * len(numbers))
    text = amc.read_text()
    for index, number in reversed(list(enumerate(numbers, 1))):
        text = text.replace(f"\n{index}\n", f"\n{number}\n", 1)
    amc.write_text(text)
    for read in (amc_frames, lambda path: read_asf_amc(asf, path)):
        with pytest.raises(
            InputError,
            match=rf"07_01\.amc: frame {numbers[1]} follows frame {numbers[0]}, expected",
        ):
            read(amc)


def test_a_motion_may_start_at_any_frame_and_have_comments(files):
    asf, amc = files({}, {})
    text = amc.read_text().replace("\n2\n", "\n118 # a comment\n").replace("\n1\n", "\n117\n")
    amc.write_text(text)
    assert amc_frames(amc) == 2 == len(read_asf_amc(asf, amc).times_s)


def test_a_byte_order_mark_and_names_in_any_language_are_read(files):
    asf, amc = files({})
    expected = read_asf_amc(asf, amc)
    for path in (asf, amc):
        path.write_bytes(b"\xef\xbb\xbf" + path.read_text().replace("lfemur", "左腕").encode())
    take = read_asf_amc(asf, amc)
    assert "左腕" in take.names
    np.testing.assert_array_equal(take.positions, expected.positions)
