"""How long a run will take, by how long its jobs took so far."""

import json
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import NamedTuple

_UNKNOWN_S = 10.0  # a job of a rule that nothing is known of
_TRUSTED_S = 60.0  # first jobs are short, and say little of how fast a machine is


class RunningJob(NamedTuple):
    """A job that has been started."""

    rule: str
    name: str  # with its wildcards
    log: str  # path of its log, or empty
    started: float  # by `time.monotonic`


class Estimate:
    """What is left to do.

    Jobs of a rule are taken to last as long as those that are done. For rules of which none is
    done, the mean times of the default experiment count, times the factor by which the other
    rules were slower than there.
    """

    def __init__(self) -> None:
        """Begin without jobs."""
        self._began = time.monotonic()
        self.cores = 1  # that may be used
        self._planned: Counter[str] = Counter()
        self._took: dict[str, list[float]] = defaultdict(list)
        text = (files(__package__) / "seconds.json").read_text()
        self._usual: dict[str, float] = json.loads(text)

    def plan(self, counts: Mapping[str, int]) -> None:
        """Jobs per rule, finished ones included."""
        self._planned = Counter(counts)

    def finish(self, rule: str, seconds: float) -> None:
        """Count a job as done."""
        self._took[rule].append(seconds)

    @property
    def done(self) -> int:
        """Number of finished jobs."""
        return sum(map(len, self._took.values()))

    @property
    def total(self) -> int:
        """Number of all jobs."""
        return max(sum(self._planned.values()), self.done)

    def left_s(self, running: Sequence[RunningJob] = ()) -> float:
        """Seconds until the end, as if as many jobs ran side by side as so far."""
        now = time.monotonic()
        usual = sum(len(took) * self._usual_s(rule) for rule, took in self._took.items())
        spent = sum(map(sum, self._took.values()))
        factor = (spent + _TRUSTED_S) / (usual + _TRUSTED_S)
        left = 0.0
        for rule, count in self._planned.items():
            took = self._took.get(rule, [])
            each = sum(took) / len(took) if took else factor * self._usual_s(rule)
            going = [now - job.started for job in running if job.rule == rule]
            waiting = max(0, count - len(took) - len(going))
            left += waiting * each + sum(max(0.0, each - since) for since in going)
        spent += sum(now - job.started for job in running)
        side_by_side = (
            spent / max(now - self._began, 1e-3) if self.done > self.cores else self.cores
        )
        return left / max(1.0, side_by_side)

    def _usual_s(self, rule: str) -> float:
        return self._usual.get(rule, _UNKNOWN_S)


def in_words(seconds: float) -> str:
    """A time with as many digits as are of interest."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    if minutes < 10:
        return f"{int(minutes)} min {int(seconds % 60):02d} s"
    if minutes < 90:
        return f"{minutes:.0f} min"
    return f"{minutes / 60:.1f} h"
