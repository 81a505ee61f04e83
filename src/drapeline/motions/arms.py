"""Upper arms that do not spin when the elbow is straight.

Where an elbow is a hinge, the twist of the upper arm is read off the direction of the forearm. With
the arm nearly straight that direction says little, and captured twists jump. A sleeve would follow.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES

TRUSTED_FLEXION_RAD = np.radians(30.0)  # from here on the captured twist is kept
_SMOOTH_S = 0.13


def steady_upper_arms(poses: np.ndarray, *, fps: float, cyclic: bool) -> np.ndarray:
    """Smooth the twist of upper arms in time as far as the elbow is straight.

    Args:
        poses: (N, 72) radians.
        fps: frames per second.
        cyclic: whether the last frame is followed by the first.

    Returns:
        Poses (N, 72) with other shoulder rotations. Upper arms point where they did; a forearm
        moves by no more than its small angle to the upper arm allows.
    """
    out = np.array(poses, dtype=np.float64).reshape(-1, 24, 3)
    mode = "wrap" if cyclic else "nearest"
    for side in ("left", "right"):
        shoulder, elbow = (JOINT_NAMES.index(f"{side}_{part}") for part in ("shoulder", "elbow"))
        turn = Rotation.from_rotvec(out[:, shoulder])
        flexion = np.linalg.norm(out[:, elbow], axis=1)
        trust = np.clip(flexion / TRUSTED_FLEXION_RAD, 0.0, 1.0) ** 2
        trust = gaussian_filter1d(trust, _SMOOTH_S * fps / 2, mode=mode)
        quat = turn.as_quat()
        twist = np.unwrap(2 * np.arctan2(quat[:, 0], quat[:, 3]))  # about X, the arm's direction
        smooth = gaussian_filter1d(twist, _SMOOTH_S * fps, mode=mode)
        change = np.zeros((len(out), 3))
        change[:, 0] = (1.0 - trust) * (smooth - twist)
        out[:, shoulder] = (turn * Rotation.from_rotvec(change)).as_rotvec()
    return out.reshape(-1, 72)
