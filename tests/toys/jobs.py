"""Files of jobs as Snakemake hands them over, and jobs without Snakemake."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drapeline.job import Job
from toys.threads import THREADS


class Named(list[str]):
    """Files of a job: by position and by name, as Snakemake's own; a name may have a list."""

    def __init__(self, *files: Any, **named: Any) -> None:
        self._named = {
            name: [*map(str, path)] if isinstance(path, list) else str(path)
            for name, path in named.items()
        }
        super().__init__(map(str, files))
        for path in self._named.values():
            self.extend(path if isinstance(path, list) else [path])

    def __getattr__(self, name: str) -> Any:
        try:
            return self._named[name]
        except KeyError:
            raise AttributeError(name) from None

    def __getitem__(self, key: Any) -> Any:
        return self._named[key] if isinstance(key, str) else super().__getitem__(key)

    def get(self, name: str, default: Any = None) -> Any:
        """The file of a name."""
        return self._named.get(name, default)


def job_of(given: Mapping[str, Any], output: Path, progress: Path | str = "", **told: Any) -> Job:
    """A job with files by name that leaves one folder.

    Args:
        told: its params.
    """
    return Job(Named(**given), [output], SimpleNamespace(**told), THREADS, "c", str(progress))
