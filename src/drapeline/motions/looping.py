"""Cyclic motions: closing a cycle without a seam, and repeating it with its displacement."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.motions.motion import Cycle, Motion, interpolate

SEAM_S = 0.8  # the mismatch between a cycle's ends is blended out over this time


def close_cycle(
    poses: np.ndarray,
    trans: np.ndarray,
    times_s: np.ndarray,
    *,
    fps: float,
    straight: bool = False,
) -> tuple[np.ndarray, np.ndarray, Cycle]:
    """Close one round of a cyclic motion whose last pose nearly equals its first.

    The round is stretched by less than half a frame to fill whole frames, and the difference of
    the last pose from the first is blended out over the round's last `SEAM_S` seconds.

    Args:
        poses: (N, 72) radians in the Z-up world, first and last frame being the same instant of
            the cycle.
        trans: (N, 3) metres.
        times_s: (N,) strictly increasing.
        fps: frames per second of the result.
        straight: the heading of one round to the next is the same; else what the clip shows.

    Returns:
        Poses (M, 72) and trans (M, 3) of one round without the repeated instant, and how the
        round moves the body on.
    """
    duration = times_s[-1] - times_s[0]
    count = max(round(duration * fps), 2)
    grid = times_s[0] + duration * np.arange(count + 1) / count
    poses, trans = interpolate(poses, trans, times_s, grid)
    cycle = Cycle(0.0 if straight else _turn(poses[0, :3], poses[-1, :3]), np.zeros(2))
    around = Rotation.from_rotvec([0.0, 0.0, cycle.turn_rad])
    shift = trans[-1] - around.apply(trans[0])
    cycle = replace(cycle, shift_m=shift[:2])
    target = poses[0].reshape(24, 3).copy()
    target[0] = (around * Rotation.from_rotvec(target[0])).as_rotvec()
    end = Rotation.from_rotvec(poses[-1].reshape(24, 3))
    lack = (end.inv() * Rotation.from_rotvec(target)).as_rotvec()  # (24, 3)
    window = min(SEAM_S * fps, count)
    weight = np.clip((np.arange(count + 1) - (count - window)) / window, 0.0, 1.0)
    weight = weight**2 * (3 - 2 * weight)
    fix = Rotation.from_rotvec((weight[:, None, None] * lack).reshape(-1, 3))
    poses = (Rotation.from_rotvec(poses.reshape(-1, 3)) * fix).as_rotvec().reshape(-1, 72)
    trans = trans.copy()
    trans[:, 2] -= weight * shift[2]
    return poses[:-1], trans[:-1], cycle


def loop_to(motion: Motion, frames: int) -> Motion:
    """Repeat a cyclic motion, each round starting where the last one ended, to `frames` frames."""
    if motion.cycle is None:
        return motion
    cycle, length = motion.cycle, len(motion)
    poses, trans = [], []
    heading, place = 0.0, np.zeros(3)
    for _ in range(-(-frames // length)):
        around = Rotation.from_rotvec([0.0, 0.0, heading])
        turned = motion.poses.copy()
        turned[:, :3] = (around * Rotation.from_rotvec(turned[:, :3])).as_rotvec()
        poses.append(turned)
        trans.append(around.apply(motion.trans) + place)
        # One round maps x to turn(x) + shift; rounds are composed.
        place = place + around.apply([*cycle.shift_m, 0.0])
        heading += cycle.turn_rad
    poses, trans = np.concatenate(poses)[:frames], np.concatenate(trans)[:frames]
    return replace(motion, poses=poses, trans=trans, cycle=None)


def _turn(first: np.ndarray, last: np.ndarray) -> float:
    """Heading change in radians about the vertical that best turns one root onto the other."""
    turn = (Rotation.from_rotvec(last) * Rotation.from_rotvec(first).inv()).as_matrix()
    return float(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
