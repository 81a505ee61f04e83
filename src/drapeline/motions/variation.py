"""Pieces of a motion at another speed, and their mirror images."""

import math
from dataclasses import replace

import numpy as np

from drapeline.bodies.kinematics import mirror_poses
from drapeline.frames import FPS
from drapeline.motions.motion import Motion, interpolate


def piece_frames(span: int, speed: float) -> int:
    """Frames that a piece of `span` frames of a clip takes at a speed, both ends included."""
    # Rounding must not lose the last frame of a span that a whole number of steps fills.
    return int((span - 1) / speed + 1e-6) + 1


def piece_span(frames: int, speed: float) -> int:
    """Frames of a clip that a piece of so many frames needs at a speed."""
    return math.ceil((frames - 1) * speed - 1e-6) + 1


def cut_piece(
    motion: Motion, start: int, stop: int, *, speed: float = 1.0, mirrored: bool = False
) -> Motion:
    """A piece of a clip at 30 fps, faster or slower than recorded, or with left and right changed.

    Args:
        start, stop: frames of the clip that the piece lies in.
        speed: seconds of the clip per second of the piece.
        mirrored: whether to mirror the piece in the plane x = 0 of the world.
    """
    if speed == 1:
        poses, trans = motion.poses[start:stop], motion.trans[start:stop]
    else:
        times = start + speed * np.arange(piece_frames(stop - start, speed))
        clip = np.arange(len(motion)) / FPS
        poses, trans = interpolate(motion.poses, motion.trans, clip, times / FPS)
    if mirrored:
        poses, trans = mirror_poses(poses), trans * np.array([-1, 1, 1])
    return replace(motion, poses=poses, trans=trans, cycle=None)
