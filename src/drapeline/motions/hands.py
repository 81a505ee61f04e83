"""Hands that lie on the floor where a straight hand would poke through it.

Many skeletons stop at the wrist, or record little of it: a person who leans on both hands then
has fingers below the floor. The wrist is bent, preferably towards the back of the hand as when
leaning on a palm, just far enough to keep the fingertips above.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES
from drapeline.motions.floor import WRIST_RADIUS_M
from drapeline.motions.motion import Motion
from drapeline.motions.skeleton import (
    REFERENCE_LEG_LENGTH_M,
    poses_from_globals,
    reference_joints,
)

HAND_LENGTH_M = 0.20  # wrist to fingertips of the reference skeleton
MAX_BEND_RAD = np.radians(85.0)
_SMOOTH_FRAMES = 2
# A palm turned a little away from the floor still counts as leaning on it: otherwise an upright
# forearm would flip between bending the hand back and forth.
_PALM_SLACK = 0.3


def lay_hands(motion: Motion) -> Motion:
    """Bend wrists where fingertips would be below z = 0; wrists and arms stay where they are."""
    joints, rotations = reference_joints(
        motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m
    )
    size = motion.reference_leg_length_m / REFERENCE_LEG_LENGTH_M
    changed = False
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wrist, hand = JOINT_NAMES.index(f"{side}_wrist"), JOINT_NAMES.index(f"{side}_hand")
        along = rotations[:, wrist, :, 0] * sign
        back = rotations[:, wrist, :, 1]
        height = (joints[:, wrist, 2] / size - WRIST_RADIUS_M) / HAND_LENGTH_M
        bend = _needed_bend(along[:, 2], back[:, 2], np.maximum(height, 0.0))
        if not bend.any():
            continue
        changed = True
        bend = _smooth(bend, cyclic=motion.cycle is not None)
        turn = Rotation.from_rotvec(np.cross(along, back) * bend[:, None]).as_matrix()
        rotations[:, wrist] = turn @ rotations[:, wrist]
        rotations[:, hand] = turn @ rotations[:, hand]
    return replace(motion, poses=poses_from_globals(rotations)) if changed else motion


def _needed_bend(along_z: np.ndarray, back_z: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N,) radians towards the back of the hand, negative towards the palm, smallest that helps.

    Args:
        along_z: vertical part of the direction from wrist to fingertips.
        back_z: vertical part of the direction out of the back of the hand.
        height: of the wrist above the floor in hand lengths, at least 0.
    """
    # Bent by b, the hand's slope is cos(b) along_z + sin(b) back_z = reach cos(b - steepest).
    reach = np.maximum(np.hypot(along_z, back_z), 1e-9)
    steepest = np.arctan2(back_z, along_z)
    leaning = back_z > -_PALM_SLACK * np.abs(along_z)
    steepest = np.where(leaning & (steepest < 0), steepest + 2 * np.pi, steepest)
    limit = np.arccos(np.clip(-height / reach, -1.0, 1.0))
    bend = np.where(leaning, steepest - limit, steepest + limit)
    return np.where(along_z < -height, np.clip(bend, -MAX_BEND_RAD, MAX_BEND_RAD), 0.0)


def _smooth(bend: np.ndarray, *, cyclic: bool) -> np.ndarray:
    """Ease in and out around the frames that need a bend, never less than they need."""
    mode = "wrap" if cyclic else "nearest"
    width = 4 * _SMOOTH_FRAMES + 1

    def widen(part: np.ndarray) -> np.ndarray:
        return gaussian_filter1d(
            maximum_filter1d(part, width, mode=mode), _SMOOTH_FRAMES, mode=mode
        )

    return widen(np.maximum(bend, 0.0)) - widen(np.maximum(-bend, 0.0))
