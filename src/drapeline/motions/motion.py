"""One motion: SMPL poses and a root path at 30 fps, with where it came from, and its cycle."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import FPS, JOINT_NAMES
from drapeline.motions.skeleton import REFERENCE_LEG_LENGTH_M
from drapeline.storage import load_npz, save_npz

MAX_FRAMES = 300  # of a sub-sequence, as in CLOTH3D
MAX_SPEED_M_S = 30.0  # of the root; anything faster is a wrong unit


@dataclass(frozen=True)
class Cycle:
    """Displacement of the body over one round of a cyclic motion."""

    turn_rad: float  # change of heading about the vertical
    shift_m: np.ndarray  # (2,) horizontal displacement of the root, seen in the first frame's world


@dataclass(frozen=True)
class Motion:
    """A motion of the SMPL skeleton in the Z-up world.

    Attributes:
        poses: (N, 72) float64 axis-angle in radians, SMPL order; the root holds the turn from
            the body's Y-up frame to the world.
        trans: (N, 3) float64 position of the root joint in metres, floor at z = 0.
        action: label such as "walk"; empty if unknown.
        subject: who moved; empty if unknown.
        source: name of the file it was read from.
        sequence: name of the sequence; sub-sequences add ``_s{k}``.
        reference_leg_length_m: hip to knee to ankle of the skeleton that `trans` is meant for.
        cycle: how one round moves the body on if the motion repeats, else None.
    """

    poses: np.ndarray
    trans: np.ndarray
    fps: float
    action: str
    subject: str
    source: str
    sequence: str
    reference_leg_length_m: float = REFERENCE_LEG_LENGTH_M
    cycle: Cycle | None = None

    def __len__(self) -> int:
        return len(self.poses)


def check_motion(motion: Motion) -> Motion:
    """Return the motion if its arrays are usable.

    Raises:
        InputError: names the file, the frame and joint, and what was expected.
    """
    poses, trans, source = motion.poses, motion.trans, motion.source
    if poses.ndim != 2 or poses.shape[1] != 72:
        raise InputError(f"{source}: poses of shape {poses.shape}, expected (frames, 72)")
    if trans.shape != (len(poses), 3):
        raise InputError(f"{source}: trans of shape {trans.shape}, expected ({len(poses)}, 3)")
    if len(poses) == 0:
        raise InputError(f"{source}: holds 0 frames, expected at least 1")
    if not (np.isfinite(motion.fps) and motion.fps > 0):
        raise InputError(f"{source}: {motion.fps} frames per second, expected a positive number")
    bad = ~np.isfinite(poses)
    if bad.any():
        frame, column = np.argwhere(bad)[0]
        joint = JOINT_NAMES[column // 3]
        raise InputError(
            f"{source}: frame {frame}, joint {joint} is {poses[frame, column]}, "
            "expected a finite angle"
        )
    if not np.isfinite(trans).all():
        frame = int(np.argmin(np.isfinite(trans).all(1)))
        raise InputError(f"{source}: frame {frame}, root is at {trans[frame]}, expected metres")
    speed = np.linalg.norm(np.diff(trans, axis=0), axis=1) * motion.fps
    if len(speed) and speed.max() > MAX_SPEED_M_S:
        frame = int(speed.argmax())
        raise InputError(
            f"{source}: frame {frame}, the root moves at {speed.max():.0f} m/s, expected less "
            f"than {MAX_SPEED_M_S:.0f} (is the file's unit metres?)"
        )
    return motion


def save_motion(path: str | Path, motion: Motion) -> None:
    """Write a motion to `.npz`; docs/reference/data-format.md lists the keys."""
    check_motion(motion)
    arrays = {
        "poses": np.asarray(motion.poses, dtype=np.float64),
        "trans": np.asarray(motion.trans, dtype=np.float64),
        "fps": np.float64(motion.fps),
        "action": motion.action,
        "subject": motion.subject,
        "source": motion.source,
        "sequence": motion.sequence,
        "reference_leg_length_m": np.float64(motion.reference_leg_length_m),
    }
    if motion.cycle is not None:
        arrays["cycle_turn_rad"] = np.float64(motion.cycle.turn_rad)
        arrays["cycle_shift_m"] = np.asarray(motion.cycle.shift_m, dtype=np.float64)
    save_npz(path, **arrays)


# What is wrong with poses and places is told by frame and joint; see `check_motion`.
_ARRAYS = {
    "poses": "number|nan ...",
    "trans": "number|nan ...",
    "fps": "number|nan",
    "reference_leg_length_m": "number",
    **dict.fromkeys(("action?", "subject?", "source?", "sequence?"), "str"),
    "cycle_turn_rad?": "number",
    "cycle_shift_m?": "number 2",
}


def load_motion(path: str | Path) -> Motion:
    """Read a motion written by `save_motion`.

    Raises:
        InputError: the file is missing, unreadable, lacks a key or holds unusable values.
    """
    a = load_npz(path, _ARRAYS)
    cycle = None
    if "cycle_turn_rad" in a and "cycle_shift_m" in a:
        cycle = Cycle(float(a["cycle_turn_rad"]), a["cycle_shift_m"].astype(np.float64))
    stem = Path(path).stem
    motion = Motion(
        a["poses"].astype(np.float64),
        a["trans"].astype(np.float64),
        float(a["fps"]),
        str(a.get("action", "")),
        str(a.get("subject", "")),
        str(a.get("source", Path(path).name)),
        str(a.get("sequence", stem)),
        float(a["reference_leg_length_m"]),
        cycle,
    )
    check_motion(replace(motion, source=str(path)))
    return motion


def resampled_count(frames: int, fps: float, *, to_fps: float = FPS) -> int:
    """Frames left after resampling: the first frame and every 1/`to_fps` s within the clip."""
    return int(np.floor((frames - 1) / fps * to_fps + 1e-6)) + 1


def resample(motion: Motion, *, to_fps: float = FPS) -> Motion:
    """Resample by slerp per joint and linear interpolation of the root's path."""
    if motion.fps == to_fps:
        return motion
    check_motion(motion)
    times = np.arange(len(motion)) / motion.fps
    new = np.arange(resampled_count(len(motion), motion.fps, to_fps=to_fps)) / to_fps
    poses, trans = interpolate(motion.poses, motion.trans, times, new)
    return replace(motion, poses=poses, trans=trans, fps=float(to_fps))


def interpolate(
    poses: np.ndarray, trans: np.ndarray, times_s: np.ndarray, new_times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Poses and root path at other times, the ends held.

    Args:
        poses: (N, 72) radians.
        trans: (N, 3) metres.
        times_s: (N,) strictly increasing.
        new_times_s: (M,) any.

    Returns:
        Poses (M, 72) by spherical and trans (M, 3) by linear interpolation.
    """
    if len(times_s) == 1:
        return np.repeat(poses, len(new_times_s), 0), np.repeat(trans, len(new_times_s), 0)
    low = np.clip(np.searchsorted(times_s, new_times_s, side="right") - 1, 0, len(times_s) - 2)
    span = times_s[low + 1] - times_s[low]
    part = np.clip((new_times_s - times_s[low]) / span, 0.0, 1.0)
    start = Rotation.from_rotvec(poses[low].reshape(-1, 3))
    end = Rotation.from_rotvec(poses[low + 1].reshape(-1, 3))
    step = (start.inv() * end).as_rotvec() * np.repeat(part, 24)[:, None]
    turned = (start * Rotation.from_rotvec(step)).as_rotvec().reshape(-1, 72)
    return turned, trans[low] + part[:, None] * (trans[low + 1] - trans[low])


def split_lengths(frames: int, *, max_frames: int = MAX_FRAMES) -> list[int]:
    """Lengths of the sub-sequences of a motion of `frames` frames; the last may be shorter."""
    return [min(max_frames, frames - start) for start in range(0, frames, max_frames)]


def split(motion: Motion, *, max_frames: int = MAX_FRAMES) -> list[Motion]:
    """Cut a motion into sub-sequences named ``{sequence}_s{k}`` of at most `max_frames`."""
    parts = []
    for index, length in enumerate(split_lengths(len(motion), max_frames=max_frames)):
        rows = slice(index * max_frames, index * max_frames + length)
        parts.append(
            replace(
                motion,
                poses=motion.poses[rows],
                trans=motion.trans[rows],
                sequence=f"{motion.sequence}_s{index}",
                cycle=None,
            )
        )
    return parts


SEAM_S = 0.8  # the mismatch between a cycle's ends is blended out over this time


def close_cycle(
    poses: np.ndarray, trans: np.ndarray, times_s: np.ndarray, *, fps: float, straight: bool = False
) -> tuple[np.ndarray, np.ndarray, Cycle]:
    """Close one round of a cyclic motion whose last pose nearly equals its first.

    The round is stretched by less than half a frame to fill whole frames, and the difference of
    the last pose from the first is blended out over the round's last `SEAM_S` seconds.

    Args:
        poses: (N, 72) radians in the Z-up world, first and last frame being the same instant of
            the cycle.
        trans: (N, 3) metres.
        times_s: (N,) strictly increasing.
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
