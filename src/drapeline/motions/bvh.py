"""Biovision (.bvh) files: any skeleton, any channel order."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.motions.skeleton import Take, globals_from_locals

REST_JUMP_DEG = 20.0
_NTSC = 1000 / 1001
_MOST_LINES = 20_000  # of a skeleton: two thousand joints
_USUAL_FPS = (
    *(24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300, 360, 480),
    *(500, 1000, 24 * _NTSC, 30 * _NTSC, 60 * _NTSC, 120 * _NTSC),
)


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
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: no file, expected a BVH motion")
    try:
        try:
            return _read_halves(path, "utf-8-sig", motion_lines)
        except UnicodeDecodeError:  # names of an older Western program
            return _read_halves(path, "latin-1", motion_lines)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, expected a BVH motion") from error
    except OSError as error:
        raise InputError(
            f"{path}: not readable ({error.strerror}), expected a BVH motion"
        ) from error


def _read_halves(
    path: Path, encoding: str, motion_lines: int | None
) -> tuple[list[str], list[str]]:
    head: list[str] = []
    with open(path, encoding=encoding) as stream:
        for line in stream:
            if line.strip().upper() == "MOTION":
                return head, list(islice(stream, motion_lines))
            if len(head) >= _MOST_LINES:
                raise InputError(
                    f"{path}: more than {_MOST_LINES} lines before 'MOTION', expected a skeleton"
                )
            head.append(line)
    raise InputError(f"{path}: has no line 'MOTION', expected a whole BVH file")


class _Words:
    """The words of a hierarchy one by one; braces are words of their own.

    Attributes:
        line: number of the line that the last word stands in.
    """

    def __init__(self, lines: list[str]) -> None:
        self._words = [
            (number, word)
            for number, line in enumerate(lines, 1)
            for word in line.replace("{", " { ").replace("}", " } ").split()
        ]
        self._next = 0
        self.line = 1

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        if self._next == len(self._words):
            raise StopIteration
        self.line, word = self._words[self._next]
        self._next += 1
        return word

    def name(self) -> str:
        """A joint's name, up to the brace or the end of its line: it may hold blanks."""
        parts = [next(self)]
        while self._next < len(self._words):
            line, word = self._words[self._next]
            if word == "{" or line != self.line:
                break
            parts.append(next(self))
        return " ".join(parts)

    def open_brace(self) -> None:
        """The brace that a joint's description begins with.

        Raises:
            ValueError: there is another word.
        """
        word = next(self)
        if word != "{":
            raise ValueError(f"'{word}', expected '{{'")


def _parse_hierarchy(path: Path, lines: list[str]) -> _JointTree:
    words = _Words(lines)
    hierarchy = _JointTree()
    stack: list[int] = []  # joints whose braces are open
    try:
        if next(words, "").upper() != "HIERARCHY":
            raise InputError(f"{path}: does not start with 'HIERARCHY', expected a BVH file")
        for word in words:
            _parse_word(word.upper(), words, hierarchy, stack)
        if stack:
            raise ValueError(f"'{hierarchy.names[stack[-1]]}' is not closed, expected '}}'")
    except (StopIteration, ValueError, IndexError) as error:
        if isinstance(error, InputError):
            raise
        problem = str(error) if isinstance(error, ValueError) else "the hierarchy is cut off"
        raise InputError(f"{path}: line {words.line}: {problem}") from error
    _check_hierarchy(path, hierarchy)
    return hierarchy


def _parse_word(key: str, words: _Words, hierarchy: _JointTree, stack: list[int]) -> None:
    """Read on from a keyword; `stack` holds the joints whose braces are open.

    Raises:
        ValueError, IndexError, StopIteration: the hierarchy is malformed or ends here.
    """
    if key in ("ROOT", "JOINT"):
        hierarchy.names.append(words.name())
        hierarchy.parents.append(stack[-1] if stack else -1)
        hierarchy.offsets.append([])
        hierarchy.channels.append([])
        words.open_brace()
        stack.append(len(hierarchy.names) - 1)
    elif key == "END":
        words.name()
        _skip_end_site(words)
    elif key == "}" and stack:
        closed = stack.pop()
        hierarchy.offsets[closed] = hierarchy.offsets[closed] or [0.0, 0.0, 0.0]
    elif key == "OFFSET" and stack and not hierarchy.offsets[stack[-1]]:
        hierarchy.offsets[stack[-1]] = [float(next(words)) for _ in range(3)]
    elif key == "CHANNELS" and stack and not hierarchy.channels[stack[-1]]:
        hierarchy.channels[stack[-1]] = [next(words) for _ in range(int(next(words)))]
    elif key in ("{", "}", "OFFSET", "CHANNELS"):
        raise ValueError(f"'{key}' out of place in the hierarchy (a brace dropped or doubled?)")
    else:
        raise ValueError(f"'{key}' in the hierarchy, expected a BVH keyword")


def _skip_end_site(words: _Words) -> None:
    words.open_brace()
    word = next(words)
    if word.upper() == "OFFSET":
        for _ in range(3):
            float(next(words))
        word = next(words)
    if word != "}":
        raise ValueError(f"'{word}' in an end site, expected an OFFSET and '}}'")


def _check_hierarchy(path: Path, hierarchy: _JointTree) -> None:
    if not hierarchy.names or hierarchy.parents.count(-1) != 1:
        roots = hierarchy.parents.count(-1)
        raise InputError(f"{path}: has {roots} ROOT joints, expected 1")
    name, times = Counter(hierarchy.names).most_common(1)[0]
    if times > 1:
        raise InputError(f"{path}: joint {name} appears twice, expected unique names")
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
    digits = ""
    for index, row in enumerate(rows):
        key, _, value = row.partition(":")
        try:
            if key.strip().lower() == "frames":
                count = int(value)
            elif key.strip().lower() == "frame time":
                frame_time, digits = float(value), value
        except ValueError as error:
            raise InputError(f"{path}: '{row.strip()}', expected a number") from error
        if count is not None and frame_time is not None:
            if count < 1:
                raise InputError(f"{path}: holds {count} frames, expected at least 1")
            if not (np.isfinite(frame_time) and frame_time > 0):
                raise InputError(f"{path}: frame time {frame_time}, expected seconds above 0")
            return count, _exact_frame_time(frame_time, digits, count), index + 1
    raise InputError(f"{path}: lacks 'Frames:' or 'Frame Time:', expected a whole BVH file")


def _exact_frame_time(written_s: float, digits: str, count: int) -> float:
    """Seconds per frame of the usual rate that was rounded or cut to the digits written.

    What is written is kept where the rate is not a usual one, or where rounding moves the last of
    `count` frames by less than resampling takes for nothing.
    """
    step = 10.0 ** int(Decimal(digits.strip()).as_tuple().exponent)
    if step > 0.001:  # too few digits to tell rates apart
        return written_s
    exact = min((1 / rate for rate in _USUAL_FPS), key=lambda time: abs(time - written_s))
    off = abs(exact - written_s)
    if off >= step or off > 0.015 * exact or off * count * FPS < 1e-6:
        return written_s
    return exact


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
