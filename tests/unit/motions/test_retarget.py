import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.bvh import read_bvh
from drapeline.motions.joint_map import JointMap, built_in_map
from drapeline.motions.retarget import measured_twists, retarget
from drapeline.motions.skeleton import (
    REFERENCE_OFFSETS,
    Y_UP_TO_Z_UP,
    Take,
    chain,
    globals_from_locals,
    globals_from_poses,
    reference_joints,
    rotation_between,
)
from toys.limbs import INDEX, directions
from toys.motion_files import SMPL_TO_CMU_BVH, random_turns, smooth_turns, write_bvh

SIGNS = {"left": 1.0, "right": -1.0}


def arm(side, roll_deg, *, flexion_deg=(0.0, 40.0, 90.0, 130.0), wobble_deg=0.0):
    """Upper arm anywhere and forearm bent forward, on a rest pose rolled by an angle about +X."""
    rng = np.random.default_rng(0)
    flexion = np.radians(flexion_deg)
    upper = random_turns(rng, (len(flexion),), 2.0)
    bend = Rotation.from_rotvec(flexion[:, None] * [0.0, -SIGNS[side], 0.0])
    wobble = Rotation.from_rotvec(rng.normal(scale=np.radians(wobble_deg), size=(len(flexion), 3)))
    roll = Rotation.from_euler("X", roll_deg, degrees=True).as_matrix()
    forearm = upper @ (bend * wobble).as_matrix()
    return upper @ roll, forearm @ roll


@pytest.mark.parametrize("roll_deg", [0.0, 30.0, -40.0, 90.0, 170.0])
def test_the_roll_of_a_rest_pose_is_undone(roll_deg):
    twists = measured_twists({side: arm(side, roll_deg) for side in SIGNS})
    # Twists are about the limbs' own directions, +X on the left and -X on the right.
    expected = {
        f"{side}_{part}": sign * roll_deg
        for side, sign in SIGNS.items()
        for part in ("shoulder", "elbow")
    }
    assert twists == pytest.approx(expected, abs=1e-6)


def test_an_arm_that_stays_straight_mirrors_the_other():
    straight = arm("right", 30.0, flexion_deg=(0.0, 3.0, 5.0))
    twists = measured_twists({"left": arm("left", 30.0), "right": straight})
    assert twists["right_shoulder"] == pytest.approx(-30.0)
    twists = measured_twists(
        {"left": arm("left", 30.0, flexion_deg=(0.0, 4.0)), "right": arm("right", -10.0)}
    )
    assert twists["left_elbow"] == pytest.approx(-10.0)


def test_nothing_is_measured_where_no_arm_bends_about_an_axis():
    straight = {side: arm(side, 30.0, flexion_deg=(0.0, 2.0)) for side in SIGNS}
    assert measured_twists(straight) == {}
    rng = np.random.default_rng(1)
    anyhow = {
        side: (random_turns(rng, (300,), 2.0), random_turns(rng, (300,), 2.0)) for side in SIGNS
    }
    assert measured_twists(anyhow) == {}


def test_an_elbow_that_is_not_quite_a_hinge_has_its_mean_axis():
    flexion = np.linspace(0, 120, 200)
    arms = {side: arm(side, 30.0, flexion_deg=flexion, wobble_deg=8.0) for side in SIGNS}
    twists = measured_twists(arms)
    assert twists["left_shoulder"] == pytest.approx(30.0, abs=2.0)
    assert twists["right_shoulder"] == pytest.approx(-30.0, abs=2.0)


SAME_NAMES = JointMap("test", {name: name for name in JOINT_NAMES if "hand" not in name})


def rest_offsets(arms_deg: float = 0.0, legs_deg: float = 0.0) -> np.ndarray:
    """The reference skeleton with arms lowered and legs opened by an angle."""
    offsets = REFERENCE_OFFSETS.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        down = Rotation.from_rotvec([0, 0, -sign * np.radians(arms_deg)])
        out = Rotation.from_rotvec([0, 0, sign * np.radians(legs_deg)])
        for part in ("elbow", "wrist", "hand"):
            offsets[INDEX[f"{side}_{part}"]] = down.apply(offsets[INDEX[f"{side}_{part}"]])
        for part in ("knee", "ankle", "foot"):
            offsets[INDEX[f"{side}_{part}"]] = out.apply(offsets[INDEX[f"{side}_{part}"]])
    return offsets


def take_of(rotations: np.ndarray, offsets: np.ndarray, names=JOINT_NAMES) -> Take:
    """A take with SMPL's joints from global rotations (N, 24, 3, 3)."""
    positions = chain(PARENTS, rotations, offsets[None])
    times = np.arange(len(rotations)) / 30
    return Take("a.bvh", tuple(names), PARENTS, offsets, rotations, positions, times)


@pytest.mark.parametrize("order", ["".join(p) for p in itertools.permutations("XYZ")])
@pytest.mark.parametrize(("arms_deg", "legs_deg"), [(0, 0), (45, 10), (90, 0), (-30, 20)])
def test_limbs_point_where_the_file_points_them(tmp_path, order, arms_deg, legs_deg):
    rng = np.random.default_rng(0)
    offsets = rest_offsets(arms_deg, legs_deg)
    local = random_turns(rng, (6, 24), 1.0)
    root = rng.normal(size=(6, 3))
    path = write_bvh(tmp_path / "a.bvh", local, root, offsets=offsets, order=order)
    take = read_bvh(path)
    poses, trans = retarget(take, built_in_map(take))
    expected = chain(PARENTS, globals_from_locals(PARENTS, local), offsets[None]) @ Y_UP_TO_Z_UP.T
    joints, _ = reference_joints(poses, trans)
    np.testing.assert_allclose(directions(joints), directions(expected), atol=1e-6)


def test_an_arm_lifted_by_ninety_degrees_points_up(tmp_path):
    local = np.tile(np.eye(3), (1, 24, 1, 1))
    local[0, INDEX["left_shoulder"]] = Rotation.from_euler("Z", 90, degrees=True).as_matrix()
    take = read_bvh(write_bvh(tmp_path / "a.bvh", local, np.zeros((1, 3))))
    poses, trans = retarget(take, built_in_map(take))
    joints, _ = reference_joints(poses, trans)
    forearm = joints[0, INDEX["left_wrist"]] - joints[0, INDEX["left_elbow"]]
    np.testing.assert_allclose(forearm / np.linalg.norm(forearm), [0, 0, 1], atol=1e-7)
    right = joints[0, INDEX["right_wrist"]] - joints[0, INDEX["right_elbow"]]
    np.testing.assert_allclose(right / np.linalg.norm(right), [-1, 0, 0], atol=1e-7)


def test_rest_pose_of_the_source_does_not_matter():
    rng = np.random.default_rng(1)
    rotations = globals_from_locals(PARENTS, random_turns(rng, (5, 24), 0.8))
    expected, _ = retarget(take_of(rotations, rest_offsets()), SAME_NAMES)
    # The same people, moving alike, on a skeleton whose rest pose hangs its arms and opens its
    # legs: every limb's rotation is now measured from there.
    offsets, changed = rest_offsets(80, 12), rotations.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        down = Rotation.from_rotvec([0, 0, -sign * np.radians(80)]).as_matrix()
        out = Rotation.from_rotvec([0, 0, sign * np.radians(12)]).as_matrix()
        for turn, parts in (
            (down, ("shoulder", "elbow", "wrist")),
            (out, ("hip", "knee", "ankle", "foot")),
        ):
            for part in parts:
                changed[:, INDEX[f"{side}_{part}"]] = rotations[:, INDEX[f"{side}_{part}"]] @ turn.T
    poses, _ = retarget(take_of(changed, offsets), SAME_NAMES)
    np.testing.assert_allclose(
        globals_from_poses(poses)[:, :22], globals_from_poses(expected)[:, :22], atol=1e-7
    )


@pytest.mark.parametrize("unit", [1.0, 100.0, 1 / 0.056444])
@pytest.mark.parametrize("axes", [(0, 0, 0), (90, 0, 0), (0, 90, 0), (-90, 0, 90)])
def test_unit_and_axes_of_the_file_do_not_matter(unit, axes):
    rng = np.random.default_rng(2)
    take = take_of(globals_from_locals(PARENTS, smooth_turns(rng, 5, 24, 0.6)), rest_offsets(60, 5))
    expected = retarget(take, SAME_NAMES)
    turn = Rotation.from_euler("XYZ", axes, degrees=True).as_matrix().round(12)
    other = Take(
        take.source,
        take.names,
        take.parents,
        unit * take.offsets @ turn.T,
        turn @ take.rotations @ turn.T,
        unit * take.positions @ turn.T,
        take.times_s,
    )
    for ours, theirs in zip(retarget(other, SAME_NAMES), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-7)


def test_a_mirrored_take_gives_the_mirrored_pose():
    rng = np.random.default_rng(3)
    rotations = globals_from_locals(PARENTS, smooth_turns(rng, 4, 24, 0.7))
    flip = np.diag([-1.0, 1.0, 1.0])
    other = {"left": "right", "right": "left"}
    swap = [
        INDEX["_".join([other[n.split("_")[0]], n.split("_")[1]])] if "_" in n else INDEX[n]
        for n in JOINT_NAMES
    ]
    poses, trans = retarget(take_of(rotations, rest_offsets(30)), SAME_NAMES)
    mirrored, path = retarget(
        take_of(flip @ rotations[:, swap] @ flip, rest_offsets(30)), SAME_NAMES
    )
    np.testing.assert_allclose(
        globals_from_poses(mirrored), _flip_world(globals_from_poses(poses)[:, swap]), atol=1e-7
    )
    np.testing.assert_allclose(path, trans * [-1, 1, 1], atol=1e-9)


def _flip_world(rotations: np.ndarray) -> np.ndarray:
    flip = np.diag([-1.0, 1.0, 1.0])
    return flip @ rotations @ flip


def test_smpl_to_bvh_and_back(tmp_path):
    rng = np.random.default_rng(4)
    local = smooth_turns(rng, 12, 24, 0.9)
    local[:, [INDEX["left_hand"], INDEX["right_hand"]]] = np.eye(3)
    root = rng.normal(size=(12, 3))
    path = write_bvh(tmp_path / "a.bvh", local, root, names=JOINT_NAMES, order="YXZ")
    take = read_bvh(path)
    poses, trans = retarget(take, built_in_map(take))
    expected = globals_from_locals(PARENTS, local)
    np.testing.assert_allclose(globals_from_poses(poses), Y_UP_TO_Z_UP @ expected, atol=1e-6)
    np.testing.assert_allclose(trans, root @ Y_UP_TO_Z_UP.T, atol=1e-6)


def bent_elbows(roll_deg):
    """A motion with elbows that are hinges, on a rest pose with arms rolled by an angle about +X.

    The rest poses of the CMU database are rolled by 30 degrees, those of others with the same joint
    names are not.
    """
    rng = np.random.default_rng(5)
    local = smooth_turns(rng, 12, 24, 0.5)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        flexion = np.linspace(0.2, 1.8, 12)[:, None]
        bend = Rotation.from_rotvec(flexion * [0.0, -sign, 0.0])
        local[:, INDEX[f"{side}_elbow"]] = bend.as_matrix()
    rotations = globals_from_locals(PARENTS, local)
    roll = Rotation.from_euler("X", roll_deg, degrees=True).as_matrix()
    rolled = rotations.copy()
    for part in ("shoulder", "elbow"):
        for side in ("left", "right"):
            rolled[:, INDEX[f"{side}_{part}"]] = rotations[:, INDEX[f"{side}_{part}"]] @ roll
    names = [SMPL_TO_CMU_BVH[name] for name in JOINT_NAMES]
    return rotations, take_of(rolled, rest_offsets(), names)


@pytest.mark.parametrize("roll_deg", [0, 30, -40])
def test_elbows_bend_about_smpls_axis_however_the_arms_of_a_skeleton_are_rolled(roll_deg):
    rotations, take = bent_elbows(roll_deg)
    poses, _ = retarget(take, built_in_map(take))
    arms = [INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "elbow")]
    np.testing.assert_allclose(
        globals_from_poses(poses)[:, arms], (Y_UP_TO_Z_UP @ rotations)[:, arms], atol=1e-7
    )


def test_a_twist_that_the_joint_map_gives_is_not_measured():
    rotations, take = bent_elbows(30)
    given = {f"{side}_{part}": 0.0 for side in ("left", "right") for part in ("shoulder", "elbow")}
    poses, _ = retarget(take, replace(built_in_map(take), twist_deg=given))
    shoulder = INDEX["left_shoulder"]
    off = np.swapaxes(globals_from_poses(poses)[:, shoulder], 1, 2) @ (
        Y_UP_TO_Z_UP @ rotations[:, shoulder]
    )
    angles = np.degrees(Rotation.from_matrix(off).magnitude())
    np.testing.assert_allclose(angles, 30, atol=1e-6)


def test_a_chest_turn_is_spread_over_the_spine():
    rotations = np.tile(np.eye(3), (1, 24, 1, 1))
    turned = Rotation.from_euler("Y", 60, degrees=True).as_matrix()
    for name in ("spine3", "neck", "head", *(n for n in JOINT_NAMES if "shoulder" in n)):
        rotations[0, INDEX[name]] = turned
    joints = {n: n for n in SAME_NAMES.joints if n not in ("spine1", "spine2", "neck")}
    poses, _ = retarget(take_of(rotations, rest_offsets()), JointMap("test", joints))
    local = np.degrees(poses[0].reshape(24, 3))
    for name in ("spine1", "spine2", "spine3"):
        np.testing.assert_allclose(local[INDEX[name]], [0, 20, 0], atol=1e-6)
    np.testing.assert_allclose(local[[INDEX["neck"], INDEX["head"]]], 0, atol=1e-6)


def test_a_bow_is_spread_over_the_spine_in_whichever_direction_the_body_faces():
    heading = Rotation.from_euler("Y", 70, degrees=True).as_matrix()
    rotations = np.tile(heading, (1, 24, 1, 1))
    bow = Rotation.from_euler("X", 60, degrees=True).as_matrix()
    for name in ("spine3", "neck", "head", *(n for n in JOINT_NAMES if "shoulder" in n)):
        rotations[0, INDEX[name]] = heading @ bow
    joints = {n: n for n in SAME_NAMES.joints if n not in ("spine1", "spine2", "neck")}
    poses, _ = retarget(take_of(rotations, rest_offsets()), JointMap("test", joints))
    local = np.degrees(poses[0].reshape(24, 3))
    for name in ("spine1", "spine2", "spine3"):
        np.testing.assert_allclose(local[INDEX[name]], [20, 0, 0], atol=1e-6)


def test_feet_turn_ahead_and_keep_their_pitch():
    offsets = rest_offsets()
    for side, sign in (("left", 1.0), ("right", -1.0)):  # toes out by 30 degrees, ankles high
        offsets[INDEX[f"{side}_foot"]] = [sign * 0.05, -0.12, 0.05 * np.sqrt(3)]
    rotations = np.tile(np.eye(3), (1, 24, 1, 1))
    poses, _ = retarget(take_of(rotations, offsets), SAME_NAMES)
    soles = globals_from_poses(poses)[0, [INDEX["left_ankle"], INDEX["right_ankle"]]]
    np.testing.assert_allclose(soles @ [0, 1, 0], [[0, 0, 1], [0, 0, 1]], atol=1e-9)  # flat
    heading = np.degrees(np.arctan2((soles @ [0, 0, 1])[:, 0], -(soles @ [0, 0, 1])[:, 1]))
    np.testing.assert_allclose(heading, [30, -30], atol=1e-6)  # as the source's toes point


def test_up_axis_can_be_given():
    rotations = np.tile(np.eye(3), (1, 24, 1, 1))
    lying = JointMap("test", SAME_NAMES.joints, up="Z")  # the rest pose lies on its back
    poses, _ = retarget(take_of(rotations, rest_offsets()), lying)
    up = globals_from_poses(poses)[0, 0] @ [0, 0, 1]  # its front
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)


def test_between_opposite_directions_is_half_a_turn():
    turn = rotation_between(np.array([0, 0, 1.0]), np.array([0, 0, -1.0]))
    np.testing.assert_allclose(turn @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)


def test_legs_without_length_are_refused():
    offsets = rest_offsets()
    for side in ("left", "right"):
        offsets[[INDEX[f"{side}_knee"], INDEX[f"{side}_ankle"]]] = 0
    rotations = np.tile(np.eye(3), (1, 24, 1, 1))
    with pytest.raises(InputError, match=r"a\.bvh: legs of length 0"):
        retarget(take_of(rotations, offsets), SAME_NAMES)
