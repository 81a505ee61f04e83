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
from drapeline.motions.joint_map import built_in_map
from drapeline.motions.joint_names import name_joints
from drapeline.motions.joint_structure import find_joints
from drapeline.motions.motion import load_motion
from drapeline.motions.skeleton import (
    REFERENCE_OFFSETS,
    Y_UP_TO_Z_UP,
    Take,
    chain,
    globals_from_poses,
    poses_from_globals,
    reference_joints,
)
from toys.limbs import INDEX, directions
from toys.motion_files import SMPL_TO_CMU_BVH, write_bvh

CLIPS = Path(__file__).parents[3] / "workflow" / "resources" / "motions"
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
    return globals_from_poses(clip.poses[::2]), clip.trans[::2]


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


def exported(path, dance, *, rig="stands", up="Y", unit=100.0, sides=1.0, called=None):
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
    called = called or SMPL_TO_CMU_BVH
    names = [called[name] for name in JOINT_NAMES]
    if sides < 0:
        other = {"Left": "Right", "Right": "Left"}
        names = [next((n.replace(s, o) for s, o in other.items() if s in n), n) for n in names]
    return write_bvh(
        path, local, unit * trans @ world.T, names=tuple(names), offsets=unit * offsets, order="ZXY"
    )


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


def spelling(middle, limbs):
    """Names by SMPL's joint; `limbs` are patterns with {side}."""
    trunk = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
    names = dict(zip(trunk, middle.split(), strict=True))
    parts = ["hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist", "hand"]
    for part, pattern in zip(parts, [*limbs.split(), "{side}FingerTip"], strict=True):
        for side in ("left", "right"):
            words = {"side": side, "Side": side.title(), "S": side[0].upper(), "s": side[0]}
            names[f"{side}_{part}"] = pattern.format(**words).replace("~", " ")
    return names


ARM = "{Side}Shoulder {Side}Arm {Side}ForeArm {Side}Hand"
MOCAP = "{Side}UpLeg {Side}Leg {Side}Foot {Side}Toe " + ARM
ROKOKO = "{Side}Thigh {Side}Shin {Side}Foot {Side}Toe " + ARM
SOMA = "{Side}Leg {Side}Shin {Side}Foot {Side}ToeBase " + ARM
BANDAI = (
    "UpperLeg_{S} LowerLeg_{S} Foot_{S} Toes_{S} Shoulder_{S} UpperArm_{S} LowerArm_{S} Hand_{S}"
)
XSENS = (
    "{Side}Hip {Side}Knee {Side}Ankle {Side}Toe {Side}Collar {Side}Shoulder {Side}Elbow {Side}Wrist"
)
KINECT = (
    "Hip{Side} Knee{Side} Ankle{Side} Foot{Side}"
    " Clavicle{Side} Shoulder{Side} Elbow{Side} Hand{Side}"
)
UNREAL = "thigh_{s} calf_{s} foot_{s} ball_{s} clavicle_{s} upperarm_{s} lowerarm_{s} hand_{s}"
RIGIFY = "thigh.{S} shin.{S} foot.{S} toe.{S} shoulder.{S} upper_arm.{S} forearm.{S} hand.{S}"
BIPED = (
    "Bip01~{S}~Thigh Bip01~{S}~Calf Bip01~{S}~Foot Bip01~{S}~Toe0 Bip01~{S}~Clavicle"
    " Bip01~{S}~UpperArm Bip01~{S}~Forearm Bip01~{S}~Hand"
)
POSER = "{s}Thigh {s}Shin {s}Foot {s}Toe {s}Collar {s}Shldr {s}ForeArm {s}Hand"
SPELLINGS = {
    "lafan1": spelling("Hips Spine Spine1 Spine2 Neck Head", MOCAP),
    "maya": spelling("rig:Hips rig:Spine a:Spine1 b:Spine2 Neck Head", MOCAP.lower()),
    "blanks": spelling("Hips LowerBack Spine Spine1 Neck Head", MOCAP.replace("{", "Bip01~{")),
    "bandai_namco": spelling("Hips Spine Spine1 Chest Neck Head", BANDAI),
    "100style_xsens": spelling("Hips Chest Chest2 Chest3 Neck Head", XSENS),
    "rokoko": spelling("Hips Spine Spine2 Spine3 Neck Head", ROKOKO),
    "soma": spelling("Hips Spine1 Spine2 Chest Neck1 Head", SOMA),
    "kinect": spelling("SpineBase SpineMid SpineA SpineShoulder Neck Head", KINECT),
    "unreal": spelling("pelvis spine_01 spine_02 spine_03 neck_01 head", UNREAL),
    "rigify": spelling("pelvis spine spine.001 spine.002 neck face", RIGIFY),
    "biped": spelling("Bip01 Spine Spine1 Spine2 Neck Head", BIPED),
    "poser": spelling("hip abdomen waist chest neck head", POSER),
}


@pytest.mark.parametrize("program", SPELLINGS)
def test_joints_are_found_by_the_names_of_many_programs(tmp_path, dance, program, caplog):
    called = SPELLINGS[program]
    take = read_bvh(exported(tmp_path / "a.bvh", [part[:2] for part in dance], called=called))
    with caplog.at_level("INFO", logger="drapeline"):
        joints = built_in_map(take).joints
    assert "a.bvh: joints found by their names: " in caplog.text
    expected = {joint: name for joint, name in called.items() if "hand" not in joint}
    assert {"head": called["head"]} | joints == expected  # a head may be called anything


def test_the_spine_is_what_lies_between_legs_and_arms(tmp_path, dance):
    """Whatever it is called: a root below the pelvis, joints between, fingers and twists."""
    names = ("root", "Hips", "A", "B", "C", "D", "E", "Neck")
    parents = [-1, 0, 1, 2, 3, 4, 5, 6]
    for side in ("Left", "Right"):
        for start, limb in ((1, "Hip UpLeg Leg Foot Toe"), (6, "Arm ForeArm Hand HandThumb1")):
            for part in limb.split():
                names += (f"{side}{part}",)
                parents.append(start)
                start = len(parents) - 1
    count = len(names)
    take = Take(
        *("a", names, np.array(parents), np.ones((count, 3))),
        *(np.tile(np.eye(3), (1, count, 1, 1)), np.zeros((1, count, 3)), np.zeros(1)),
    )
    joints = name_joints(take)
    assert [joints[f"spine{k}"] for k in (1, 2, 3)] == ["A", "C", "E"]
    assert (joints["pelvis"], joints["left_hip"], joints["neck"]) == ("Hips", "LeftUpLeg", "Neck")


@pytest.mark.parametrize(("old", "new"), [("LeftForeArm", "Elle"), ("RightLeg", "LeftLeg2")])
def test_a_person_who_lacks_a_limb_is_not_found_by_names(tmp_path, dance, old, new):
    called = {joint: new if name == old else name for joint, name in SMPL_TO_CMU_BVH.items()}
    take = read_bvh(exported(tmp_path / "a.bvh", [part[:2] for part in dance], called=called))
    assert name_joints(take) == {}


NUMBERED = {name: f"node {(7 * k) % 24}" for k, name in enumerate(JOINT_NAMES)}


@pytest.mark.parametrize("rig", ["stands", "along_x", "along_x_mirrored", "anyhow"])
@pytest.mark.parametrize("up", TO_Z_UP)
def test_joints_whose_names_say_nothing_are_found_by_the_skeletons_shape(
    tmp_path, dance, rig, up, caplog
):
    path = exported(tmp_path / "a.bvh", dance, rig=rig, up=up, called=NUMBERED)
    with caplog.at_level("WARNING", logger="drapeline"):
        joints = built_in_map(read_bvh(path)).joints
    assert "a.bvh: joints found by the skeleton's shape: pelvis: node 0" in caplog.text
    assert joints == NUMBERED
    assert apart_deg(import_motion(path, lock_feet=False), dance) < 1.0


def without(take, *gone):
    """The take without some joints, of which no other hangs."""
    kept = [k for k, name in enumerate(take.names) if name not in gone]
    parents = [kept.index(take.parents[k]) if take.parents[k] >= 0 else -1 for k in kept]
    arrays = (getattr(take, name)[:, kept] for name in ("rotations", "positions"))
    names = tuple(take.names[k] for k in kept)
    return Take(take.source, names, np.array(parents), take.offsets[kept], *arrays, take.times_s)


@pytest.mark.parametrize(
    "limb", [("left_hip", "left_knee", "left_ankle", "left_foot"), ("right_elbow", "right_wrist")]
)
def test_what_is_no_persons_skeleton_is_refused(tmp_path, dance, limb):
    take = read_bvh(exported(tmp_path / "a.bvh", dance, called=NUMBERED))
    hand = ("right_hand",) if "right_wrist" in limb else ()
    with pytest.raises(InputError, match=r"a\.bvh: joints .* fit no built-in map"):
        built_in_map(without(take, *(NUMBERED[name] for name in (*limb, *hand))))


def test_skeletons_of_many_joints_end_soon(dance):
    count = 1500
    chain_of = np.arange(count) - 1
    take = Take(
        *("a", tuple(map(str, range(count))), chain_of, np.ones((count, 3))),
        *(np.tile(np.eye(3), (1, count, 1, 1)), np.zeros((1, count, 3)), np.zeros(1)),
    )
    assert find_joints(take) == {}


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
