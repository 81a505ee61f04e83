"""The table that lists the motions of an experiment, and the frame counts of their files."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drapeline.errors import InputError
from drapeline.motions.importing import frame_count
from drapeline.storage import check_name, read_json, read_rows, write_json


class FrameCounts:
    """Frame counts of files as they are now; a file that has changed is read anew.

    They are kept in `memory`, a JSON file, unless it is None; one that is unusable is ignored.
    """

    def __init__(self, memory: str | Path | None = None) -> None:
        self._memory = None if memory is None else Path(memory)
        self._known = _load(self._memory)
        self._used: dict[str, int] = {}

    def count(self, path: str, frames: int | None, **numbers: float) -> int:
        """`frame_count` of a file; sizes and times of files tell whether it has changed.

        Raises:
            InputError: as `frame_count` does.
        """
        try:
            state = Path(path).stat()
        except OSError:
            return frame_count(path, frames=frames, **numbers)  # says what is wrong
        key = f"{path} {state.st_size} {state.st_mtime_ns} {frames} {sorted(numbers.items())}"
        if key not in self._used:
            known = self._known.get(key)
            self._used[key] = (
                frame_count(path, frames=frames, **numbers) if known is None else known
            )
        return self._used[key]

    def remember(self) -> None:
        """Keep the counts for the next start."""
        if self._memory is None or self._used.keys() <= self._known.keys():
            return
        with suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            write_json(self._memory, self._used)


def _load(memory: Path | None) -> dict[str, int]:
    try:
        known = {} if memory is None else read_json(memory, dict)
    except (ValueError, OSError):  # whatever is wrong, the files are read anew
        return {}
    return {key: count for key, count in known.items() if type(count) is int and count > 0}


REQUIRED = ("name", "file")
OPTIONAL = ("action", "subject", "loop", "joint_map", "asf", "amc_fps", "start_s", "end_s")
# Columns that describe a clip for people and are not read.
DESCRIPTIVE = ("frames", "source", "note")


@dataclass(frozen=True)
class MotionEntry:
    """One row of a motion table."""

    name: str
    path: str
    frames: int  # frames it has once imported, at 30 fps
    loop_frames: int | None  # length to which the cycle is repeated, or None
    # action, subject: labels; empty leaves the file's own.
    action: str
    subject: str
    # joint_map, asf: further files it needs, or None.
    joint_map: str | None
    asf: str | None
    numbers: dict[str, float]  # of `amc_fps`, `start_s` and `end_s`, those that are given

    @property
    def files(self) -> dict[str, str]:
        """Every file that the import reads, by argument name."""
        named = {"motion": self.path, "joint_map": self.joint_map, "asf": self.asf}
        return {name: path for name, path in named.items() if path}

    def parameters(self) -> dict[str, Any]:
        """The other arguments of `import_motion`."""
        return {
            "frames": self.loop_frames,
            "action": self.action,
            "subject": self.subject,
            "sequence": self.name,
            **self.numbers,
        }


def motion_table(
    path: str | Path,
    names: Sequence[str] = (),
    *,
    loop_frames: int,
    counts: FrameCounts | None = None,
) -> dict[str, MotionEntry]:
    """Read the motions named, or all of them, from a tab-separated table.

    Args:
        path: columns `name` and `file` (relative to the table's folder), and optionally `action`,
            `subject`, `loop` (yes: the clip is one round of a cycle), `joint_map`, `asf`,
            `amc_fps`, and `start_s` and `end_s`, the part of the file that is the clip. Names
            become parts of paths, see `storage.NAME_RULE`; files may be called anything.
        names: which rows, in this order; all rows if empty.
        loop_frames: length in frames that cyclic clips are repeated to.
        counts: frame counts that are known already.

    Raises:
        InputError: names the table, the row or name, and what was expected.
    """
    path = Path(path)
    heading, rows = read_rows(path, "a table of motions")
    if not rows:
        raise InputError(f"{path}: lists no motion, expected at least one row below the header")
    known, columns = {*REQUIRED, *OPTIONAL, *DESCRIPTIVE}, set(heading)
    if not columns <= known or not set(REQUIRED) <= columns:
        raise InputError(
            f"{path}: columns {', '.join(sorted(columns))}, expected {' and '.join(REQUIRED)}"
            f" and perhaps {', '.join([*OPTIONAL, *DESCRIPTIVE])}, separated by tabs"
        )
    for number, row in enumerate(rows, 1):
        check_name(row["name"], f"{path}: the name of motion {number}")
    by_name = {row["name"]: row for row in rows}
    if len(by_name) < len(rows):
        listed = [row["name"] for row in rows]
        twice = next(name for name in listed if listed.count(name) > 1)
        raise InputError(f"{path}: '{twice}' is listed twice, expected each name once")
    for name in names:
        if name not in by_name:
            raise InputError(f"{path}: lists no '{name}', expected one of {', '.join(by_name)}")
    chosen = [by_name[name] for name in names] if names else rows
    counts = counts or FrameCounts()
    return {row["name"]: _entry(path, row, loop_frames, counts) for row in chosen}


def _entry(table: Path, row: dict[str, str], loop_frames: int, counts: FrameCounts) -> MotionEntry:
    loop = row.get("loop") or "no"
    if loop not in ("yes", "no"):
        raise InputError(f"{table}: '{row['name']}' has loop '{loop}', expected yes or no")
    if not row["file"]:
        raise InputError(f"{table}: '{row['name']}' has no file, expected the motion's")
    numbers = {
        **_number(table, row, "amc_fps", "above 0", lambda number: number > 0),
        **_number(table, row, "start_s", "of at least 0", lambda number: number >= 0),
        **_number(table, row, "end_s", "above 0", lambda number: number > 0),
    }
    if loop == "yes" and not numbers.keys().isdisjoint(("start_s", "end_s")):
        raise InputError(
            f"{table}: '{row['name']}' has loop yes and start_s or end_s, expected a whole round"
        )

    def beside(column: str) -> str | None:
        return str(table.parent / row[column]) if row.get(column) else None

    length = loop_frames if loop == "yes" else None
    file = str(table.parent / row["file"])
    try:
        frames = counts.count(file, length, **numbers)
    except InputError as error:
        raise InputError(f"{table}: '{row['name']}': {error}") from error
    return MotionEntry(
        row["name"],
        file,
        frames,
        length,
        row.get("action") or "",
        row.get("subject") or "",
        beside("joint_map"),
        beside("asf"),
        numbers,
    )


def _number(
    table: Path, row: dict[str, str], column: str, expected: str, fine: Callable[[float], bool]
) -> dict[str, float]:
    """The number in a column, by its name, if there is one."""
    text = row.get(column)
    if not text:
        return {}
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and fine(number)):
        raise InputError(
            f"{table}: '{row['name']}' has {column} '{text:.100}', expected a number {expected}"
        )
    return {column: number}
