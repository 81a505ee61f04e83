"""Feet that stay where they stand: legs are bent a little so that a standing foot does not slide.

While a foot rests on the floor, the travel of the points it stands on is subtracted from it;
between two rests the correction is interpolated smoothly. The hip and the knee follow by the law
of cosines, the foot keeps its direction and the root its path.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from drapeline.frames import JOINT_NAMES
from drapeline.motions.floor import MIN_REST_FRAMES, SOLES_BY_SIDE, sole_rests, touch_points
from drapeline.motions.looping import loop_to
from drapeline.motions.motion import Motion
from drapeline.motions.retarget import rotation_between
from drapeline.motions.skeleton import poses_from_globals, reference_joints

MAX_SHIFT_M = 0.10  # a foot is not moved further than this from where it was captured
_CLEAR_BEND = 0.15  # sine of the flexion from which a knee's own plane is trusted
_MAX_REACH = 0.999  # of the leg's length; a leg is never pulled straighter than this


def lock_feet(motion: Motion) -> Motion:
    """Remove sliding and floating of resting feet; a cyclic motion stays cyclic.

    Args:
        motion: a motion on the floor.

    Returns:
        The motion with other hip, knee and ankle rotations.
    """
    if motion.cycle is None:
        return _lock(motion)
    count = len(motion)
    # The middle of three rounds has neighbours on both sides, and its poses fit every round.
    rounds = _lock(loop_to(motion, 3 * count))
    middle = rounds.poses[count : 2 * count].reshape(-1, 24, 3)
    poses = motion.poses.reshape(-1, 24, 3).copy()
    poses[:, 1:] = middle[:, 1:]  # rotations below the root do not depend on where it is
    return replace(motion, poses=poses.reshape(-1, 72))


def _lock(motion: Motion) -> Motion:
    if len(motion) < 2 * MIN_REST_FRAMES:
        return motion
    joints, rotations = reference_joints(
        motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m
    )
    resting, travel = sole_rests(motion)
    points = touch_points(motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m)
    for side, (name, soles) in enumerate(zip(("left", "right"), SOLES_BY_SIDE, strict=True)):
        height = points[:, soles, 2].min(1)
        shift = _shift(resting[:, side], travel[:, side], height)
        _bend_leg(joints, rotations, name, shift)
    return replace(motion, poses=poses_from_globals(rotations))


def _shift(resting: np.ndarray, travel: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N, 3) displacement that stops a foot while it rests and puts it on the floor."""
    frames = np.arange(len(resting))
    if not resting.any():
        return np.zeros((len(resting), 3))
    shift = np.zeros((len(resting), 3))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], resting.astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        drift = np.concatenate([np.zeros((1, 3)), np.cumsum(travel[start : end - 1], axis=0)])
        shift[start:end] = drift.mean(0) - drift
    shift[:, 2] = -height
    known = frames[resting]
    blend = np.stack([np.interp(frames, known, shift[known, axis]) for axis in range(3)], axis=1)
    blend = _ease(blend, resting)
    blend[:, 2] = np.maximum(blend[:, 2], -height)  # a swinging foot is not pushed below the floor
    length = np.linalg.norm(blend, axis=1, keepdims=True)
    return blend * np.minimum(1.0, MAX_SHIFT_M / np.maximum(length, 1e-9))


def _ease(blend: np.ndarray, resting: np.ndarray) -> np.ndarray:
    """Replace straight lines between rests by an S-curve, so that feet do not start abruptly."""
    out = blend.copy()
    known = np.flatnonzero(resting)
    for start, end in pairwise(known):
        if end - start > 1:
            part = np.arange(end - start + 1) / (end - start)
            part = (part * part * (3 - 2 * part))[:, None]
            out[start : end + 1] = blend[start] + part * (blend[end] - blend[start])
    return out


def _bend_leg(joints: np.ndarray, rotations: np.ndarray, side: str, shift: np.ndarray) -> None:
    """Turn hip and knee so that the ankle moves by `shift`, in place; the foot keeps its turn."""
    hip, knee, ankle = (JOINT_NAMES.index(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
    for frame in np.flatnonzero(np.abs(shift).max(1) > 1e-7):
        start, bend, end = joints[frame, [hip, knee, ankle]]
        thigh, shin = bend - start, end - bend
        lengths = np.linalg.norm(thigh), np.linalg.norm(shin)
        target = end + shift[frame] - start
        longest = max(np.linalg.norm(end - start), _MAX_REACH * sum(lengths))
        reach = np.clip(np.linalg.norm(target), abs(lengths[0] - lengths[1]) + 1e-4, longest)
        hinge = _hinge(thigh, shin, rotations[frame, hip, :, 0])
        flexion = np.arctan2(np.cross(thigh, shin) @ hinge, thigh @ shin)
        # First the knee's hinge, then swing the bent leg onto the target.
        turn = _about(hinge, _flexion(*lengths, reach) - flexion)
        swing = rotation_between(thigh + turn @ shin, target)
        rotations[frame, hip] = swing @ rotations[frame, hip]
        rotations[frame, knee] = swing @ turn @ rotations[frame, knee]


def _hinge(thigh: np.ndarray, shin: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Axis (3,) about which the knee flexes: of the bend itself, or across a straight thigh.

    A leg that is captured straight, or a little beyond, must not be bent forward.
    """
    bend = np.cross(thigh, shin)
    if bend @ across > _CLEAR_BEND * np.linalg.norm(thigh) * np.linalg.norm(shin):
        return bend / np.linalg.norm(bend)
    along = thigh / np.linalg.norm(thigh)
    hinge = across - along * (across @ along)
    return hinge / np.linalg.norm(hinge)


def _flexion(thigh: float, shin: float, reach: float) -> float:
    """Flexion of the knee in radians, 0 when straight, for a hip-to-ankle distance."""
    cosine = (reach**2 - thigh**2 - shin**2) / (2 * thigh * shin)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) about a direction."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
