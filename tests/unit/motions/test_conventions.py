"""Files as the programs of others write them: one motion, written after many conventions."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.bvh import read_bvh
from drapeline.motions.importing import import_motion
from drapeline.motions.motion import load_motion
from drapeline.motions.skeleton import (
    REFERENCE_OFFSETS,
    Y_UP_TO_Z_UP,
    chain,
    globals_from_poses,
    poses_from_globals,
    reference_joints,
)
from toys.motion_files import SMPL_TO_CMU_BVH, write_bvh

CLIPS = Path(__file__).parents[3] / "workflow" / "resources" / "motions"
INDEX = {name: index for index, name in enumerate(JOINT_NAMES)}
LIMBS = [
    (f"{side}_{start}", f"{side}_{end}")
    for side in ("left", "right")
    for start, end in (
        ("hip", "knee"),
        ("knee", "ankle"),
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
    )
]
TO_Z_UP = {  # turn of a file's world that makes its vertical axis Z
    "Y": Y_UP_TO_Z_UP,
    "Z": np.eye(3),
    "-Y": Y_UP_TO_Z_UP @ np.diag([-1.0, -1.0, 1.0]),
    "X": Rotation.from_euler("Y", -90, degrees=True).as_matrix(),
}


@pytest.fixture(scope="module")
def dance():
    """Global rotations (N, 24, 3, 3) and root path (N, 3) of someone who dances, Z up."""
    clip = load_motion(CLIPS / "dance_b.npz")
    return globals_from_poses(clip.poses), clip.trans


def along_x(joint: int, sign: float = 1.0) -> np.ndarray:
    """Axes of a joint whose first bone lies along X, or against it."""
    children = np.flatnonzero(joint == PARENTS)
    bone = REFERENCE_OFFSETS[children[0]] if len(children) else REFERENCE_OFFSETS[joint]
    return Rotation.align_vectors(bone[None], [[sign, 0, 0]])[0].as_matrix()


def axes_of(rig: str) -> np.ndarray:
    """Axes (24, 3, 3) of joints by the convention of a program, from SMPL's."""
    if rig == "along_x":
        return np.stack([along_x(joint) for joint in range(24)])
    if rig == "along_x_mirrored":
        signs = [-1.0 if name.startswith("right") else 1.0 for name in JOINT_NAMES]
        return np.stack([along_x(joint, sign) for joint, sign in enumerate(signs)])
    if rig == "anyhow":
        return Rotation.random(24, random_state=0).as_matrix()
    if rig == "lies":  # on the back, as where the rest pose keeps the axes of a Z-up program
        return np.repeat(Rotation.from_euler("X", 90, degrees=True).as_matrix()[None], 24, 0)
    return np.repeat(np.eye(3)[None], 24, 0)


def exported(path, dance, *, rig="stands", up="Y", unit=100.0, sides=1.0):
    """The dance as a BVH file of some program."""
    rotations, trans = dance
    world, axes = TO_Z_UP[up].T, axes_of(rig)
    turned = world @ rotations @ axes
    offsets = REFERENCE_OFFSETS.copy()
    local = turned.copy()
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            offsets[joint] = axes[parent].T @ REFERENCE_OFFSETS[joint]
            local[:, joint] = np.swapaxes(turned[:, parent], 1, 2) @ turned[:, joint]
    names = [SMPL_TO_CMU_BVH[name] for name in JOINT_NAMES]
    if sides < 0:
        other = {"Left": "Right", "Right": "Left"}
        names = [next((n.replace(s, o) for s, o in other.items() if s in n), n) for n in names]
    return write_bvh(
        path, local, unit * trans @ world.T, names=tuple(names), offsets=unit * offsets, order="ZXY"
    )


def directions(joints):
    bones = np.stack([joints[:, INDEX[b]] - joints[:, INDEX[a]] for a, b in LIMBS], axis=1)
    return bones / np.linalg.norm(bones, axis=-1, keepdims=True)


def apart_deg(motion, dance):
    """Largest angle between limbs of an import and of plain forward kinematics, in degrees.

    Feet are not held, and the world's heading is the file's own.
    """
    rotations, _ = dance
    expected = directions(chain(PARENTS, rotations, REFERENCE_OFFSETS[None]))
    found = directions(reference_joints(motion.poses, motion.trans)[0])
    flat = [(d.reshape(-1, 3) * [1, 1, 0]) for d in (expected, found)]
    heading = np.arctan2(
        np.cross(flat[1], flat[0])[:, 2].sum(), np.einsum("na,na->", flat[1], flat[0])
    )
    found = found @ Rotation.from_euler("Z", heading).as_matrix().T
    cosine = np.einsum("nla,nla->nl", found, expected)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).max()


@pytest.mark.parametrize(
    ("rig", "unit"),
    [
        *(("stands", 1.0), ("along_x", 100.0), ("along_x_mirrored", 1 / 0.0254)),
        *(("anyhow", 1000.0), ("lies", 100.0)),
    ],
)
@pytest.mark.parametrize("up", TO_Z_UP)
def test_limbs_point_as_in_the_file_whatever_its_conventions(tmp_path, dance, rig, up, unit):
    path = exported(tmp_path / "a.bvh", dance, rig=rig, up=up, unit=unit)
    assert apart_deg(import_motion(path, lock_feet=False), dance) < 1.0


@pytest.mark.parametrize("rig", ["along_x", "along_x_mirrored", "anyhow"])
def test_joints_are_where_those_of_the_standing_twin_are(tmp_path, dance, rig):
    twin = import_motion(exported(tmp_path / "twin.bvh", dance))
    motion = import_motion(exported(tmp_path / "a.bvh", dance, rig=rig))
    found, expected = (reference_joints(m.poses, m.trans)[0] for m in (motion, twin))
    assert np.linalg.norm(found - expected, axis=-1).max() < 0.02


def test_what_was_measured_is_said(tmp_path, dance, caplog):
    with caplog.at_level("INFO", logger="drapeline"):
        import_motion(exported(tmp_path / "a.bvh", dance))
        assert not caplog.messages
        import_motion(exported(tmp_path / "b.bvh", dance, rig="along_x", up="Z"))
    said = "\n".join(caplog.messages)
    assert "b.bvh: its rest pose is no standing person" in said
    assert "b.bvh: Z is taken to be up instead of Y" in said


def test_a_map_that_gives_the_vertical_axis_is_obeyed(tmp_path, dance):
    path = exported(tmp_path / "a.bvh", dance)
    (tmp_path / "map.yaml").write_text("up: Z\n")
    lying = import_motion(path, joint_map=tmp_path / "map.yaml", lock_feet=False)
    joints, _ = reference_joints(lying.poses, lying.trans)
    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    assert (np.abs(trunk[:, 2]) < 0.6 * np.linalg.norm(trunk, axis=1)).all()


def test_exchanged_sides_are_refused(tmp_path, dance):
    path = exported(tmp_path / "a.bvh", dance, sides=-1.0)
    with pytest.raises(InputError, match=r"a\.bvh: the feet point backwards in 100 % of the"):
        import_motion(path)


def test_a_motion_that_no_axis_explains_is_refused_with_what_was_measured(tmp_path, dance):
    rotations, trans = dance
    tilt = Rotation.from_rotvec(np.radians(54) * np.array([1, -1, 0]) / np.sqrt(2)).as_matrix()
    path = exported(tmp_path / "a.bvh", (tilt @ rotations, trans), rig="along_x")
    with pytest.raises(InputError, match=r"a\.bvh: .* upright along no axis \(X in 0 %, .*'up'"):
        import_motion(path)
    (tmp_path / "map.yaml").write_text("up: Y\n")
    assert len(import_motion(path, joint_map=tmp_path / "map.yaml")) == len(rotations)


@pytest.mark.parametrize(("unit", "fits"), [("cm", True), ("m", False), ("inch", False)])
def test_a_unit_that_is_given_must_be_that_of_a_person(tmp_path, dance, unit, fits):
    path = exported(tmp_path / "a.bvh", dance, unit=100.0)
    (tmp_path / "map.yaml").write_text(f"unit: {unit}\n")
    if fits:
        motion = import_motion(path, joint_map=tmp_path / "map.yaml")
        np.testing.assert_array_equal(motion.poses, import_motion(path).poses)
    else:
        with pytest.raises(InputError, match=rf"a\.bvh: legs of [\d.]+ m by the unit '{unit}'"):
            import_motion(path, joint_map=tmp_path / "map.yaml")


def amass(path, dance, *, up="Z", unit=1.0, degrees=False, still=0.0):
    """The dance, or the pose it starts with and a little sway, as a file like AMASS's."""
    rotations, trans = dance
    world = TO_Z_UP[up].T
    poses = np.zeros((len(rotations), 156))
    turned = world @ rotations
    if still:
        turned = np.repeat(turned[:1], len(turned), 0)
        sway = still * np.sin(np.arange(len(trans)) / 10)[:, None]
        trans = trans[:1] + sway * np.array([1.0, 0.5, 0.1])
    poses[:, :66] = poses_from_globals(turned)[:, :66]
    trans = (trans @ world.T - [0, -0.22, 0.03]) / unit
    poses = np.degrees(poses) if degrees else poses
    np.savez(path, poses=poses, trans=trans, mocap_framerate=30.0)
    return path


@pytest.mark.parametrize("up", TO_Z_UP)
def test_amass_files_of_any_vertical_axis_stand(tmp_path, dance, up):
    assert apart_deg(import_motion(amass(tmp_path / "a.npz", dance, up=up)), dance) < 1.0


def test_the_vertical_axis_of_a_map_is_obeyed_by_amass_files(tmp_path, dance):
    path = amass(tmp_path / "a.npz", dance, up="Y")
    joints = {name: name for name in JOINT_NAMES}
    expected = import_motion(path)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"joints": joints, "up": "Y"}))
    found = import_motion(path, joint_map=tmp_path / "map.yaml")
    np.testing.assert_array_equal(found.poses, expected.poses)
    (tmp_path / "map.yaml").write_text("up: Z\n")
    assert apart_deg(import_motion(path, joint_map=tmp_path / "map.yaml"), dance) > 45


@pytest.mark.parametrize("unit", ["cm", "mm", "inch"])
@pytest.mark.parametrize("still", [0.0, 0.02])
def test_amass_files_in_another_unit_are_refused_unless_it_is_given(tmp_path, dance, unit, still):
    size = {"cm": 0.01, "mm": 0.001, "inch": 0.0254}[unit]
    path = amass(tmp_path / "a.npz", dance, unit=size, still=still)
    with pytest.raises(InputError, match=r"a\.npz: .*(metres|unit)"):
        import_motion(path)
    (tmp_path / "map.yaml").write_text(f"unit: {unit}\n")
    found = import_motion(path, joint_map=tmp_path / "map.yaml")
    expected = import_motion(amass(tmp_path / "b.npz", dance, still=still))
    np.testing.assert_allclose(found.trans, expected.trans, atol=1e-9)


def test_amass_files_in_degrees_are_refused(tmp_path, dance):
    path = amass(tmp_path / "a.npz", dance, degrees=True)
    with pytest.raises(InputError, match=r"a\.npz: frame \d+, joint \w+ turns by .* radians"):
        import_motion(path)


def test_a_standing_rest_pose_is_left_as_it_is(tmp_path, dance):
    """Also where the motion does not stand: someone lies down in a file that says which is up."""
    rotations, trans = dance
    angles = np.linspace(0, np.pi / 2, len(rotations))
    turn = Rotation.from_rotvec(angles[:, None] * [1.0, 0, 0]).as_matrix()
    path = exported(tmp_path / "a.bvh", (turn[:, None] @ rotations, trans))
    take = read_bvh(path)
    motion = import_motion(path, lock_feet=False)
    joints, _ = reference_joints(motion.poses, motion.trans)
    file = take.positions @ Y_UP_TO_Z_UP.T
    for side in ("left", "right"):
        ours, theirs = (
            p[:, b] - p[:, a]
            for p, a, b in (
                (joints, INDEX[f"{side}_hip"], INDEX[f"{side}_knee"]),
                (file, *(take.names.index(f"{side.title()}{part}") for part in ("UpLeg", "Leg"))),
            )
        )
        cosine = np.einsum("na,na->n", ours, theirs) / np.linalg.norm(theirs, axis=1)
        np.testing.assert_allclose(cosine / np.linalg.norm(ours, axis=1), 1, atol=1e-6)
