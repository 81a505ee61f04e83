"""Axes and conventions: metres, radians, seconds, kilograms, Z up, 30 frames per second.

A body model file is in the SMPL frame (Y up, facing +Z, arms along X); everything else is in the
world frame (Z up). The root rotation of every pose includes the change of frame: +90 degrees about
X takes Y up to Z up and leaves the body facing -Y, as in CLOTH3D.
"""

import numpy as np

FPS = 30
# CLOTH3D's rest pose: upright in the Z-up world, with each leg turned outwards by 0.15 rad.
REST_POSE = np.zeros(72)
REST_POSE[0] = np.pi / 2
REST_POSE[3 * 1 + 2] = 0.15
REST_POSE[3 * 2 + 2] = -0.15
REST_POSE.setflags(write=False)

GENDERS = ("female", "male")  # index = CLOTH3D's gender code, which files hold


def gender_codes(genders: np.ndarray) -> np.ndarray:
    """(n,) int8 codes of "female" and "male" (n,)."""
    return (np.asarray(genders) == GENDERS[1]).astype(np.int8)


def gender_names(codes: np.ndarray) -> np.ndarray:
    """(n,) "female" or "male" of codes (n,)."""
    return np.array(GENDERS)[codes]


JOINT_NAMES = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
)
PARENTS = np.array(
    [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
)
PARENTS.setflags(write=False)
