"""How wide floating-point comparisons pass: a pytest plugin that records them.

A comparison is recorded as what was found and what is allowed: the two sides of `assert x < 0.1`,
or the largest deviation as a share of the tolerance where NumPy, torch or pytest compare.
"""

import inspect
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from _pytest.assertion import rewrite

# Compiled tests that report what they assert must not be mixed up with those that do not.
rewrite.PYC_TAIL = f".margins{rewrite.PYC_TAIL}"

# File that comparisons are appended to, one JSON object per line.
FILE = "DRAPELINE_MARGINS"
_TESTS = f"{Path(__file__).parents[1]}{os.sep}"
_reached: Counter[str] = Counter()


class Margin(NamedTuple):
    """How one comparison comes out on several processors."""

    where: str  # test and line, and which time it was reached
    distance: float  # of the worst value to its limit
    spread: float  # of the distances

    @property
    def ratio(self) -> float:
        """By how many spreads the comparison passes."""
        return self.distance / self.spread if self.spread else np.inf


def margins(lines: Iterable[str]) -> list[Margin]:
    """The comparisons of recorded lines, the narrowest first."""
    distances: dict[str, list[float]] = {}
    for line in lines:
        row = json.loads(line)
        distances.setdefault(row["where"], []).append(row["limit"] - row["value"])
    found = [Margin(where, min(all_), max(all_) - min(all_)) for where, all_ in distances.items()]
    return sorted(found, key=lambda margin: margin.ratio)


def _record(test: str, line: int, value: float, limit: float) -> None:
    place = f"{test}:{line}"
    _reached[place] += 1
    row = {"where": f"{place} ({_reached[place]})", "value": float(value), "limit": float(limit)}
    with open(os.environ[FILE], "a") as file:  # one write, so that lines of processes do not mix
        file.write(json.dumps(row) + "\n")


# ---- assert x < 0.1

_NOTES = re.compile(r", (dtype|grad_fn|device)=[^,)]*")


def pytest_assertion_pass(item: pytest.Item, lineno: int, expl: str) -> None:
    """Record a passed assertion if it compares two numbers."""
    sides = re.fullmatch(r"(.+?) (<|<=|>|>=) (.+)", _NOTES.sub("", expl.splitlines()[0]))
    if sides is None:
        return
    numbers = {"tensor": lambda x: x, "array": lambda x: x}
    try:
        left, right = (eval(sides[n], {"__builtins__": {}}, numbers) for n in (1, 3))
        value, limit = (left, right) if sides[2].startswith("<") else (-left, -right)
        if not isinstance(left * right, float):
            return
    except (ArithmeticError, NameError, SyntaxError, TypeError, AttributeError):
        return
    _record(item.nodeid, lineno, value, limit)


# ---- comparisons by NumPy, torch and pytest


@pytest.fixture(autouse=True)
def _record_comparisons(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name, recorded in (
        (np.testing, "assert_allclose", _numpy_recorded),
        (torch.testing, "assert_close", _torch_recorded),
        (pytest, "approx", _approx_recorded),
    ):
        monkeypatch.setattr(module, name, recorded(getattr(module, name)))


def _record_deviation(actual: Any, expected: Any, rtol: float, atol: float) -> None:
    """The largest deviation as a share of what is allowed."""
    try:
        actual, expected = (np.asarray(x, dtype=float) for x in (actual, expected))
    except (TypeError, ValueError):
        return
    with np.errstate(all="ignore"):
        share = np.abs(actual - expected) / (atol + rtol * np.abs(expected))
    share = share[np.isfinite(share)]
    if not share.size:
        return
    frame = inspect.currentframe()
    while frame.f_code.co_filename == __file__ or not frame.f_code.co_filename.startswith(_TESTS):
        frame = frame.f_back
    _record(os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0], frame.f_lineno, share.max(), 1.0)


def _numpy_recorded(compare: Callable[..., None]) -> Callable[..., None]:
    def recorded(actual, desired, rtol=1e-7, atol=0, **options):
        _record_deviation(actual, desired, rtol, atol)
        compare(actual, desired, rtol, atol, **options)

    return recorded


def _torch_recorded(compare: Callable[..., None]) -> Callable[..., None]:
    usual = {torch.float64: (1e-7, 1e-7), torch.float32: (1.3e-6, 1e-5)}

    def recorded(actual, expected, *, rtol=None, atol=None, **options):
        if torch.is_tensor(actual) and torch.is_tensor(expected) and actual.dtype in usual:
            tolerance = usual[actual.dtype] if rtol is None else (rtol, atol)
            _record_deviation(actual.detach(), expected.detach(), *tolerance)
        compare(actual, expected, rtol=rtol, atol=atol, **options)

    return recorded


def _approx_recorded(approx: Callable[..., Any]) -> Callable[..., Any]:
    def recorded(expected, *args, **options):
        answer = approx(expected, *args, **options)
        cls = type(answer)
        if not hasattr(answer, "tolerance"):
            return answer

        def equals(self, actual):
            _record_deviation(actual, expected, 0.0, self.tolerance)
            return cls.__eq__(self, actual)

        answer.__class__ = type(cls.__name__, (cls,), {"__eq__": equals, "__hash__": None})
        return answer

    return recorded
