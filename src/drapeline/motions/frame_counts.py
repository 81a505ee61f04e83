"""Frame counts of motion files, kept from one start of Snakemake to the next.

Every job of a cluster plans its part of the experiment, and must not read thousands of clips to do
so.
"""

from contextlib import suppress
from pathlib import Path

from drapeline.motions.importing import frame_count
from drapeline.storage import read_json, write_json


class FrameCounts:
    """Frame counts of files as they are now; a file that has changed is read anew.

    Args:
        memory: JSON file that keeps them; None keeps nothing. One that cannot be read or written
            is ignored.
    """

    def __init__(self, memory: str | Path | None = None) -> None:
        self._memory = None if memory is None else Path(memory)
        self._known = _load(self._memory)
        self._used: dict[str, int] = {}

    def count(self, path: str, frames: int | None, **rate: float) -> int:
        """`frame_count` of a file; sizes and times of files tell whether it has changed.

        Raises:
            InputError: as `frame_count` does.
        """
        try:
            state = Path(path).stat()
        except OSError:
            return frame_count(path, frames=frames, **rate)  # says what is wrong
        key = f"{path} {state.st_size} {state.st_mtime_ns} {frames} {sorted(rate.items())}"
        if key not in self._used:
            known = self._known.get(key)
            self._used[key] = frame_count(path, frames=frames, **rate) if known is None else known
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
