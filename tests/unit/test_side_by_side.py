"""The arithmetic of `bench/`: turns, medians and ratios."""

import importlib.util
from itertools import count
from pathlib import Path

import pytest

FILE = Path(__file__).parents[2] / "bench" / "side_by_side.py"


@pytest.fixture
def bench(monkeypatch):
    """The module, with a clock that calls themselves move on."""
    spec = importlib.util.spec_from_file_location("side_by_side", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module.time, "process_time", lambda: module.now)
    module.now = 0.0
    return module


def test_ratios_are_those_of_turns(bench):
    calls, turn = [], count()

    def theirs():
        calls.append("theirs")
        bench.now += 0.3 + 0.1 * next(turn)

    def ours():
        calls.append("ours")
        bench.now += 0.1

    row = bench.compare("w", "p", theirs, ours, goal=5, repeats=3)
    assert calls == ["theirs", "ours"] * 4  # the first two are not counted
    assert row.ratios == pytest.approx([4, 5, 6])
    assert (row.peer_ms, row.ours_ms) == pytest.approx((500, 100))
    assert row.cells() == ["w", "p", "500", "100", "5 (4-6)", "5", ""]


def test_fast_calls_are_repeated_and_averaged(bench):
    made = []

    def fast():
        made.append(1)
        bench.now += 0.001

    row = bench.compare("w", "p", fast, fast, repeats=1)
    assert len(made) == 2 + 2 * 20
    assert row.peer_ms == pytest.approx(1)
