"""The table that lists the motions of an experiment, and the frame counts of their files."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
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
OPTIONAL = (
    *("action", "subject", "loop", "joint_map", "asf", "amc_fps", "start_s", "end_s"),
    *("sha256", "asf_sha256", "optional", "split"),
)
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
    sums: dict[str, str]  # SHA-256 that files must have, by argument name, where they are given

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


class MotionTable:
    """The motions that an experiment may use.

    Args:
        path: a tab-separated table of the columns `name` and `file` (relative to the table), and
            optionally `action`, `subject`, `loop` (yes: the clip is one round of a cycle),
            `joint_map`, `asf`, `amc_fps`, `start_s` and `end_s`, the part of the file that is the
            clip, `sha256` and `asf_sha256`, which an import compares, `optional` (yes: the clip is
            left out where it is not there and no folder is named), and `split`.
            Names become parts of paths, see `storage.NAME_RULE`; files may be called anything.
        folder: where files are that do not lie beside the table.

    Attributes:
        left_out: names of the clips that are not there.
        splits: clip -> split, of those that the table assigns to one.

    Raises:
        InputError: names the table, the row, and what was expected.
    """

    def __init__(self, path: str | Path, folder: str | Path | None = None) -> None:
        self.path, self._folder = Path(path), None if folder is None else Path(folder)
        heading, rows = read_rows(self.path, "a table of motions")
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
        self._rows = {row["name"]: row for row in rows}
        if len(self._rows) < len(rows):
            listed = [row["name"] for row in rows]
            twice = next(name for name in listed if listed.count(name) > 1)
            raise InputError(f"{path}: '{twice}' is listed twice, expected each name once")
        self.left_out = [name for name, row in self._rows.items() if self._is_left_out(row)]
        self.splits = {name: row["split"] for name, row in self._rows.items() if row.get("split")}

    def entries(
        self, names: Sequence[str] = (), *, loop_frames: int, counts: FrameCounts | None = None
    ) -> dict[str, MotionEntry]:
        """The motions named, in this order, or all; without those that are left out.

        Args:
            loop_frames: length in frames that cyclic clips are repeated to.
            counts: frame counts that are known already.

        Raises:
            InputError: names the table, the row or name, and what was expected.
        """
        for name in names:
            if name not in self._rows:
                raise InputError(
                    f"{self.path}: lists no '{name}', expected one of {', '.join(self._rows)}"
                )
        counts = counts or FrameCounts()
        chosen = [name for name in names or self._rows if name not in self.left_out]
        if not chosen:
            raise InputError(
                f"{self.path}: none of the clips is there, expected motions.folder to name the"
                " folder of their files"
            )
        return {name: self._entry(self._rows[name], loop_frames, counts) for name in chosen}

    def _is_left_out(self, row: Mapping[str, str]) -> bool:
        if not self._says_yes(row, "optional") or self._folder is not None:
            return False
        return not all((self.path.parent / name).exists() for name in self._named(row).values())

    def _says_yes(self, row: Mapping[str, str], column: str) -> bool:
        value = row.get(column) or "no"
        if value not in ("yes", "no"):
            raise InputError(
                f"{self.path}: '{row['name']}' has {column} '{value}', expected yes or no"
            )
        return value == "yes"

    def _named(self, row: Mapping[str, str]) -> dict[str, str]:
        """Column -> file, as the table has it."""
        return {c: row[c] for c in ("file", "joint_map", "asf") if row.get(c)}

    def _find(self, name: str) -> str:
        """A file's path: beside the table, or else in the folder."""
        beside = self.path.parent / name
        return str(beside if self._folder is None or beside.exists() else self._folder / name)

    def _entry(self, row: Mapping[str, str], loop_frames: int, counts: FrameCounts) -> MotionEntry:
        table, name = self.path, row["name"]
        if not row["file"]:
            raise InputError(f"{table}: '{name}' has no file, expected the motion's")
        numbers = {
            **_number(table, row, "amc_fps", "above 0", lambda number: number > 0),
            **_number(table, row, "start_s", "of at least 0", lambda number: number >= 0),
            **_number(table, row, "end_s", "above 0", lambda number: number > 0),
        }
        loop = self._says_yes(row, "loop")
        if loop and not numbers.keys().isdisjoint(("start_s", "end_s")):
            raise InputError(
                f"{table}: '{name}' has loop yes and start_s or end_s, expected a whole round"
            )
        length = loop_frames if loop else None
        files = {column: self._find(named) for column, named in self._named(row).items()}
        try:
            frames = counts.count(files["file"], length, **numbers)
        except InputError as error:
            raise InputError(f"{table}: '{name}': {error}") from error
        return MotionEntry(
            name,
            files["file"],
            frames,
            length,
            row.get("action") or "",
            row.get("subject") or "",
            files.get("joint_map"),
            files.get("asf"),
            numbers,
            {**_sum(table, row, "sha256", "motion"), **_sum(table, row, "asf_sha256", "asf")},
        )


def _sum(table: Path, row: Mapping[str, str], column: str, argument: str) -> dict[str, str]:
    """The SHA-256 in a column, by the argument whose file it is of, if there is one."""
    text = row.get(column)
    if not text:
        return {}
    if argument == "asf" and not row.get("asf"):
        raise InputError(f"{table}: '{row['name']}' has {column} and no asf, expected its file")
    if not re.fullmatch("[0-9a-f]{64}", text):
        raise InputError(
            f"{table}: '{row['name']}' has {column} '{text:.100}', expected 64 hexadecimal digits"
        )
    return {argument: text}


def _number(
    table: Path, row: Mapping[str, str], column: str, expected: str, fine: Callable[[float], bool]
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
