"""Retargeting: a motion of any humanoid skeleton as rotations of the 24 SMPL joints.

Euler angles are never copied. A source joint's global rotation says how its bone turned away from
the source's rest pose; the source's rest pose is related to SMPL's T-pose by turning each limb's
rest direction onto that of the T-pose, along the chain so that no twist is added.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.joint_map import AXES, JointMap
from drapeline.motions.skeleton import (
    REFERENCE_LEG_LENGTH_M,
    REFERENCE_OFFSETS,
    Y_UP_TO_Z_UP,
    Take,
    poses_from_globals,
    rotation_between,
    unit,
)

_MIN_FLEXION_RAD = np.radians(10.0)  # a straighter arm shows no axis
_MIN_AGREEMENT = 0.8  # length of the mean axis; 1 for a perfect hinge
_PARTS = ("shoulder", "elbow")


def measured_twists(arms: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, float]:
    """Twist in degrees of each shoulder and elbow, as `JointMap.twist_deg` has it.

    An arm that never bends, or about no particular axis, is taken to be the mirror image of the
    other. If that holds for both arms, no twist is measured.

    Args:
        arms: "left" and "right" to the global rotations (N, 3, 3) of upper arm and forearm away
            from a T-pose that points as SMPL's does, but may be rolled.

    Returns:
        Twists of `{side}_shoulder` and `{side}_elbow`, or nothing.
    """
    signs = {"left": 1.0, "right": -1.0}
    found = {side: _hinge_twist(*arms[side], signs[side]) for side in arms}
    known = {side: twist for side, twist in found.items() if twist is not None}
    if not known:
        return {}
    mirrored = {side: -next(iter(known.values())) for side in found}
    twists = {side: known.get(side, mirrored[side]) for side in found}
    return {f"{side}_{part}": twist for side, twist in twists.items() for part in _PARTS}


def _hinge_twist(upper: np.ndarray, forearm: np.ndarray, sign: float) -> float | None:
    """Angle in degrees about the arm's direction from the measured hinge to SMPL's."""
    along = np.array([sign, 0.0, 0.0])
    pointing = np.einsum("nba,nbc,c->na", upper, forearm, along)  # as the upper arm sees it
    axes = np.cross(along, pointing)
    sine = np.linalg.norm(axes, axis=1)
    bent = np.arctan2(sine, pointing @ along) > _MIN_FLEXION_RAD
    mean = axes[bent].sum(axis=0)
    if not bent.any() or np.linalg.norm(mean) < _MIN_AGREEMENT * sine[bent].sum():
        return None
    # SMPL's forearms come forward about -Y on the left and +Y on the right.
    turn = np.arctan2(0.0, -sign) - np.arctan2(mean[2], mean[1])
    return float(np.degrees(sign * np.arctan2(np.sin(turn), np.cos(turn))))


INDEX = {name: index for index, name in enumerate(JOINT_NAMES)}
SPINE = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
# Limbs that are turned onto the T-pose: joint, the joint its bone ends at, T-pose direction.
LIMBS = tuple(
    (f"{side}_{start}", f"{side}_{end}", direction)
    for side, sign in (("left", 1.0), ("right", -1.0))
    for start, end, direction in (
        ("hip", "knee", (0.0, -1.0, 0.0)),
        ("knee", "ankle", (0.0, -1.0, 0.0)),
        ("shoulder", "elbow", (sign, 0.0, 0.0)),
        ("elbow", "wrist", (sign, 0.0, 0.0)),
    )
)
_SNAP_COS = np.cos(np.radians(20.0))


def retarget(take: Take, joint_map: JointMap) -> tuple[np.ndarray, np.ndarray]:
    """Express a take as SMPL poses of the reference skeleton, on no particular floor yet.

    Args:
        joint_map: which source joint drives each SMPL joint.

    Returns:
        Poses (N, 72) in radians with the turn to the Z-up world in the root, and the root
        joint's positions (N, 3) in metres, scaled by the ratio of leg lengths.

    Raises:
        InputError: the take lacks a joint that the map names, or its legs have no length.
    """
    source = joint_map.indices(take)
    rest = take.rest_positions()
    facing = body_frame(rest, source, take.source)
    world = _world_frame(facing, joint_map.up)
    align = _alignment(rest @ facing.T, source)
    _roll_limbs(align, take.rotations @ facing.T, source, joint_map.twist_deg)
    rotations = np.zeros((len(take.rotations), 24, 3, 3))
    for name, index in source.items():
        turn = facing.T @ align[name].T
        rotations[:, INDEX[name]] = world @ take.rotations[:, index] @ turn
    _fill_spine(rotations, source)
    for joint, name in enumerate(JOINT_NAMES):  # hands, toes, collars without a source
        if name not in source and name not in SPINE:
            rotations[:, joint] = rotations[:, PARENTS[joint]]
    scale = REFERENCE_LEG_LENGTH_M / leg_length(rest, source, take.source)
    # The hips' midpoint is what the legs hang from; the root joint sits elsewhere in each rig.
    hips = take.positions[:, [source["left_hip"], source["right_hip"]]].mean(1) @ world.T
    below = REFERENCE_OFFSETS[[INDEX["left_hip"], INDEX["right_hip"]]].mean(0)
    trans = hips * scale - rotations[:, 0] @ below
    rotations = Y_UP_TO_Z_UP @ rotations
    return poses_from_globals(rotations), trans @ Y_UP_TO_Z_UP.T


def body_frame(rest: np.ndarray, source: dict[str, int], name: str) -> np.ndarray:
    """Rotation (3, 3) from the source's axes to SMPL's (left, up, front) in its rest pose.

    The axes follow from the hips and shoulders, and are snapped to the file's own axes where they
    are close: a rest pose stands upright, though its spine is bent.
    """
    hips = rest[[source["left_hip"], source["right_hip"]]]
    shoulders = rest[[source["left_shoulder"], source["right_shoulder"]]]
    up = _snap(unit(shoulders.mean(0) - hips.mean(0)))
    left = hips[0] - hips[1] + shoulders[0] - shoulders[1]
    left = left - up * (left @ up)
    if np.linalg.norm(left) < 1e-9 or not np.isfinite(left).all():
        raise InputError(
            f"{name}: hips and shoulders lie on one line, expected a standing rest pose"
        )
    left = unit(_snap(unit(left)))
    left = unit(left - up * (left @ up))
    return np.stack([left, up, np.cross(left, up)])


def _alignment(rest: np.ndarray, source: dict[str, int]) -> dict[str, np.ndarray]:
    """Per mapped joint, the turn (3, 3) from the source's rest pose to the T-pose, SMPL axes."""
    align = {joint: np.eye(3) for joint in source}
    for start, end, direction in LIMBS:
        if end not in source:
            continue
        parent = JOINT_NAMES[PARENTS[INDEX[start]]]
        before = align[parent] if start.split("_")[1] in ("knee", "elbow") else np.eye(3)
        bone = rest[source[end]] - rest[source[start]]
        align[start] = before
        if np.linalg.norm(bone) > 1e-9:
            align[start] = rotation_between(before @ bone, np.array(direction)) @ before
    for side in ("left", "right"):
        if f"{side}_wrist" in source:
            align[f"{side}_wrist"] = align[f"{side}_elbow"]
        if f"{side}_hand" in source:
            align[f"{side}_hand"] = align[f"{side}_elbow"]
        _align_foot(align, rest, source, side)
    return align


def _roll_limbs(
    align: dict[str, np.ndarray],
    rotations: np.ndarray,
    source: dict[str, int],
    twist_deg: dict[str, float],
) -> None:
    """Add the twists that are given, and those of other arms as measured, to the turns of limbs.

    Hands and feet do not take them on.

    Args:
        align: changed in place.
        rotations: (N, J, 3, 3) global rotations of the source's joints, from SMPL's axes.
        source: joint index in the take for each mapped SMPL joint.
        twist_deg: as in the joint map.
    """
    arms = {
        side: tuple(
            rotations[:, source[joint]] @ align[joint].T
            for joint in (f"{side}_shoulder", f"{side}_elbow")
        )
        for side in ("left", "right")
    }
    twists = measured_twists(arms) | twist_deg
    for joint, _, direction in LIMBS:
        axis_angle = np.radians(twists.get(joint, 0.0)) * np.array(direction)
        align[joint] = Rotation.from_rotvec(axis_angle).as_matrix() @ align[joint]


def _align_foot(
    align: dict[str, np.ndarray], rest: np.ndarray, source: dict[str, int], side: str
) -> None:
    """Feet follow their leg and are turned about the vertical to point ahead.

    Their pitch is left alone: in a rest pose the sole is flat, however high the ankle joint of a
    rig sits above its toes.
    """
    turn = align[f"{side}_knee"]
    if f"{side}_foot" in source:
        bone = turn @ (rest[source[f"{side}_foot"]] - rest[source[f"{side}_ankle"]])
        ahead = np.array([bone[0], 0.0, bone[2]])
        if ahead[2] > 0.2 * np.linalg.norm(bone):
            turn = rotation_between(ahead, np.array([0.0, 0.0, 1.0])) @ turn
        align[f"{side}_foot"] = turn
    align[f"{side}_ankle"] = turn


def _fill_spine(rotations: np.ndarray, source: dict[str, int]) -> None:
    """Spread the turn between two driven joints evenly over the spine joints between them."""
    driven = [level for level, name in enumerate(SPINE) if name in source]
    for low, high in pairwise(driven):
        start, end = rotations[:, INDEX[SPINE[low]]], rotations[:, INDEX[SPINE[high]]]
        turn = Rotation.from_matrix(np.swapaxes(start, -1, -2) @ end).as_rotvec()
        for level in range(low + 1, high):
            part = Rotation.from_rotvec(turn * (level - low) / (high - low)).as_matrix()
            rotations[:, INDEX[SPINE[level]]] = start @ part
    for level in range(driven[-1] + 1, len(SPINE)):
        rotations[:, INDEX[SPINE[level]]] = rotations[:, INDEX[SPINE[driven[-1]]]]


def leg_length(rest: np.ndarray, source: dict[str, int], name: str) -> float:
    """Mean length of both legs in the file's unit."""
    total = 0.0
    for side in ("left", "right"):
        points = rest[[source[f"{side}_{part}"] for part in ("hip", "knee", "ankle")]]
        total += np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / 2
    if not total > 1e-9:
        raise InputError(f"{name}: legs of length {total:g}, expected hip, knee and ankle apart")
    return total


def _world_frame(facing: np.ndarray, up: str | None) -> np.ndarray:
    """Rotation from the file's world to a Y-up one; `up` overrides what the rest pose suggests."""
    if up is None:
        return facing
    return rotation_between(facing @ AXES[up], np.array([0.0, 1.0, 0.0])) @ facing


def _snap(direction: np.ndarray) -> np.ndarray:
    nearest = int(np.argmax(np.abs(direction)))
    if abs(direction[nearest]) < _SNAP_COS:
        return direction
    return np.eye(3)[nearest] * np.sign(direction[nearest])
