"""Times of two ways of doing the same thing, which take turns on one core."""

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

_SHORTEST_S = 0.02  # what is faster is called several times in a row


class Comparison(NamedTuple):
    """A row of the table.

    Attributes:
        what: is done, and at which size.
        peer: how others do it.
        peer_ms, ours_ms: medians of processor time.
        ratios: peer / ours of each turn.
        goal: ratio to reach.
        note: what keeps the ratio below the goal, or what is special about the measurement.
    """

    what: str
    peer: str
    peer_ms: float
    ours_ms: float
    ratios: list[float]
    goal: float | None = None
    note: str = ""

    def cells(self) -> list[str]:
        """The row as text: the ratio is a median, with the least and the largest behind it."""
        ratio, low, high = statistics.median(self.ratios), min(self.ratios), max(self.ratios)
        return [
            self.what,
            self.peer,
            _digits(self.peer_ms),
            _digits(self.ours_ms),
            f"{ratio:.3g} ({low:.3g}-{high:.3g})",
            "" if self.goal is None else f"{self.goal:g}",
            self.note,
        ]


def _digits(number: float) -> str:
    """Three of them, and more only before the point."""
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


HEADINGS = ("what", "peer", "peer, ms", "ours, ms", "times faster", "goal", "")


def compare(
    what: str,
    peer: str,
    theirs: Callable[[], object],
    ours: Callable[[], object],
    *,
    goal: float | None = None,
    repeats: int = 7,
    note: str = "",
) -> Comparison:
    """Call both in turns, so that a busy machine slows both, after one call that is not counted."""
    calls = [max(1, round(_SHORTEST_S / cpu_seconds(way))) for way in (theirs, ours)]
    turns = [
        [cpu_seconds(way, n) for way, n in zip((theirs, ours), calls, strict=True)]
        for _ in range(repeats)
    ]
    peer_ms, ours_ms = (1000 * statistics.median(times) for times in zip(*turns, strict=True))
    return Comparison(what, peer, peer_ms, ours_ms, [a / b for a, b in turns], goal, note)


def cpu_seconds(way: Callable[[], object], calls: int = 1) -> float:
    """Mean processor time of a call."""
    start = time.process_time()
    for _ in range(calls):
        way()
    return (time.process_time() - start) / calls
