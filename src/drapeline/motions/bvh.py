"""Biovision (.bvh) files: any skeleton, any channel order."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.motions.skeleton import Take, globals_from_locals

REST_JUMP_DEG = 20.0


@dataclass
class _JointTree:
    """Joints as the HIERARCHY part declares them, in the order the MOTION part uses."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)  # such as ["Xposition", "Zrotation"]

    @property
    def width(self) -> int:
        return sum(len(channels) for channels in self.channels)


def read_bvh(path: str | Path) -> Take:
    """Read a BVH file.

    A first frame that shows the rest pose (as in the CMU conversions known as cgspeed's) is
    dropped: it is no part of the motion.

    Raises:
        InputError: names the file and what is missing, cut off or not a number.
    """
    path = Path(path)
    head, rows = _halves(path)
    hierarchy = _parse_hierarchy(path, head)
    count, frame_time_s, first_row = _parse_motion_header(path, rows)
    values = _parse_values(path, rows[first_row:], hierarchy, count)
    drop = int(_starts_with_rest_pose(values[:3], _rotation_columns(hierarchy)))
    values = values[drop:]
    parents, offsets = np.array(hierarchy.parents), np.array(hierarchy.offsets)
    local, moved = _local_transforms(hierarchy, values)
    rotations = globals_from_locals(parents, local)
    positions = np.array(moved)
    for joint in range(1, len(parents)):
        parent = parents[joint]
        step = np.einsum("nab,nb->na", rotations[:, parent], moved[:, joint])
        positions[:, joint] = positions[:, parent] + step
    times = np.arange(len(values)) * frame_time_s
    return Take(str(path), tuple(hierarchy.names), parents, offsets, rotations, positions, times)


def bvh_frames(path: str | Path) -> tuple[int, float]:
    """Number of frames that `read_bvh` returns and their rate, from the first lines alone."""
    path = Path(path)
    head, rows = _halves(path, motion_lines=6)
    hierarchy = _parse_hierarchy(path, head)
    count, frame_time_s, first_row = _parse_motion_header(path, rows)
    size = path.stat().st_size
    if 2 * count * hierarchy.width > size:  # a digit and a space for each number
        raise InputError(
            f"{path}: {size} bytes, expected more for {count} frames of {hierarchy.width} channels"
        )
    start = [row.split() for row in rows[first_row : first_row + 3] if row.strip()]
    if len(start) == 3 and all(len(row) == hierarchy.width for row in start):
        values = _numbers(path, start)
        count -= int(_starts_with_rest_pose(values, _rotation_columns(hierarchy)))
    return count, 1.0 / frame_time_s


def _halves(path: Path, *, motion_lines: int | None = None) -> tuple[list[str], list[str]]:
    """Lines of the HIERARCHY part and of the MOTION part (or only its first lines)."""
    head: list[str] = []
    rows: list[str] = []
    try:
        with open(path, encoding="latin-1") as stream:
            for line in stream:
                if line.strip().upper() == "MOTION":
                    break
                head.append(line)
            else:
                raise InputError(f"{path}: has no line 'MOTION', expected a whole BVH file")
            for line in stream:
                if motion_lines is not None and len(rows) >= motion_lines:
                    break
                rows.append(line)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, expected a BVH motion") from error
    except OSError as error:
        raise InputError(
            f"{path}: not readable ({error.strerror}), expected a BVH motion"
        ) from error
    return head, rows


def _parse_hierarchy(path: Path, lines: list[str]) -> _JointTree:
    words = iter(" ".join(lines).split())
    hierarchy = _JointTree()
    stack: list[int] = []
    try:
        if next(words, "").upper() != "HIERARCHY":
            raise InputError(f"{path}: does not start with 'HIERARCHY', expected a BVH file")
        for word in words:
            key = word.upper()
            if key in ("ROOT", "JOINT"):
                hierarchy.names.append(next(words))
                hierarchy.parents.append(stack[-1] if stack else -1)
                hierarchy.offsets.append([0.0, 0.0, 0.0])
                hierarchy.channels.append([])
            elif key == "END":
                _skip_end_site(words)
            elif key == "{":
                stack.append(len(hierarchy.names) - 1)
            elif key == "}":
                stack.pop()
            elif key == "OFFSET":
                hierarchy.offsets[-1] = [float(next(words)) for _ in range(3)]
            elif key == "CHANNELS":
                hierarchy.channels[-1] = [next(words) for _ in range(int(next(words)))]
            else:
                raise InputError(f"{path}: '{word}' in the hierarchy, expected a BVH keyword")
    except (StopIteration, RuntimeError, ValueError, IndexError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the hierarchy is cut off or malformed, expected BVH") from error
    _check_hierarchy(path, hierarchy)
    return hierarchy


def _skip_end_site(words: Iterator[str]) -> None:
    while next(words) != "}":
        pass


def _check_hierarchy(path: Path, hierarchy: _JointTree) -> None:
    if not hierarchy.names or hierarchy.parents.count(-1) != 1:
        roots = hierarchy.parents.count(-1)
        raise InputError(f"{path}: has {roots} ROOT joints, expected 1")
    twice = {name for name in hierarchy.names if hierarchy.names.count(name) > 1}
    if twice:
        raise InputError(f"{path}: joint {sorted(twice)[0]} appears twice, expected unique names")
    if not hierarchy.width:
        raise InputError(f"{path}: has no channels, expected those of joints that move")
    if not np.isfinite(hierarchy.offsets).all():
        raise InputError(f"{path}: holds an OFFSET that is not finite, expected a length")
    for name, channels in zip(hierarchy.names, hierarchy.channels, strict=True):
        for channel in channels:
            axis, kind = channel[:1].upper(), channel[1:].lower()
            if axis not in "XYZ" or kind not in ("position", "rotation"):
                raise InputError(
                    f"{path}: joint {name} has channel '{channel}', expected such as Xrotation"
                )


def _parse_motion_header(path: Path, rows: list[str]) -> tuple[int, float, int]:
    """Number of frames, seconds per frame, and the index of the first row of values."""
    count = frame_time = None
    for index, row in enumerate(rows):
        key, _, value = row.partition(":")
        try:
            if key.strip().lower() == "frames":
                count = int(value)
            elif key.strip().lower() == "frame time":
                frame_time = float(value)
        except ValueError as error:
            raise InputError(f"{path}: '{row.strip()}', expected a number") from error
        if count is not None and frame_time is not None:
            if count < 1:
                raise InputError(f"{path}: holds {count} frames, expected at least 1")
            if not (np.isfinite(frame_time) and frame_time > 0):
                raise InputError(f"{path}: frame time {frame_time}, expected seconds above 0")
            return count, frame_time, index + 1
    raise InputError(f"{path}: lacks 'Frames:' or 'Frame Time:', expected a whole BVH file")


def _parse_values(path: Path, rows: list[str], hierarchy: _JointTree, count: int) -> np.ndarray:
    """(frames, channels) values of the MOTION part."""
    values = _numbers(path, " ".join(rows).split())
    if len(values) != count * hierarchy.width:
        raise InputError(
            f"{path}: holds {len(values)} motion values, expected {count} frames of "
            f"{hierarchy.width} channels, {count * hierarchy.width} in all"
        )
    values = values.reshape(count, hierarchy.width)
    if not np.isfinite(values).all():
        frame, column = np.argwhere(~np.isfinite(values))[0]
        owners = [n for n, c in zip(hierarchy.names, hierarchy.channels, strict=True) for _ in c]
        raise InputError(
            f"{path}: frame {frame}, joint {owners[column]} holds {values[frame, column]}, "
            "expected a finite number"
        )
    return values


def _numbers(path: Path, words: list[Any]) -> np.ndarray:
    try:
        return np.array(words, dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: {error}, expected numbers in the motion part") from error


def _rotation_columns(hierarchy: _JointTree) -> np.ndarray:
    flat = [channel for channels in hierarchy.channels for channel in channels]
    return np.array([channel.lower().endswith("rotation") for channel in flat], dtype=bool)


def _starts_with_rest_pose(values: np.ndarray, rotations: np.ndarray) -> bool:
    """Whether frame 0 stands apart from frame 1 by a jump that frame 2 does not repeat."""
    if len(values) < 3:
        return False
    steps = np.abs((np.diff(values[:3, rotations], axis=0) + 180.0) % 360.0 - 180.0)
    jump, usual = steps.max(axis=1, initial=0.0)
    return bool(jump > REST_JUMP_DEG and usual < 0.25 * jump)


def _local_transforms(hierarchy: _JointTree, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local rotations (N, J, 3, 3) and offsets from the parent (N, J, 3) of every frame."""
    count = len(values)
    local = np.zeros((count, len(hierarchy.names), 3, 3))
    moved = np.repeat(np.array(hierarchy.offsets)[None], count, axis=0)
    column = 0
    for joint, channels in enumerate(hierarchy.channels):
        turn = Rotation.identity(count)
        for channel in channels:
            axis = "XYZ".index(channel[0].upper())
            if channel.lower().endswith("rotation"):
                vector = np.zeros((count, 3))
                vector[:, axis] = np.radians(values[:, column])
                turn = turn * Rotation.from_rotvec(vector)
            else:  # a position channel takes the offset's place
                moved[:, joint, axis] = values[:, column]
            column += 1
        local[:, joint] = turn.as_matrix()
    return local, moved
