"""Fixtures that every test may use."""

import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import pytest

from drapeline.bodies.model import BodyModel, free_body, load_body
from drapeline.frames import GENDERS
from portable.marks import portable_tests
from toys.bodies import toy_body as build_toy_body
from toys.threads import THREADS

END = pytest.StashKey[float]()
# Hypothesis keeps examples and constants, which would otherwise lie in the checkout.
os.environ.setdefault("HYPOTHESIS_STORAGE_DIRECTORY", f"{tempfile.gettempdir()}/hypothesis")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seconds", type=float, help="skip tests that would begin later")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Note when the last test may begin."""
    session.config.stash[END] = time.time() + (session.config.getoption("seconds") or float("inf"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test for which no time is left."""
    if time.time() > item.config.stash[END]:
        pytest.skip("no time left")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark portable tests; start with the longest files, or they would end long after others."""
    for item in items if config.option.markexpr else ():  # to find them takes seconds
        if item.originalname in portable_tests(item.path):
            item.add_marker(pytest.mark.portable)
    longest = {"test_end_to_end.py": 0, "test_workflow.py": 1}
    items.sort(key=lambda item: longest.get(item.path.name, len(longest)))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """Leave out the files that need torch where it is not installed, see `install/run.py`."""
    report = yield
    needed = re.search(r"No module named '(torch|anny|smplx)\b", report.longreprtext)
    if needed and not find_spec("torch"):
        report.outcome, report.longrepr = "skipped", (str(collector.path), 0, "Skipped: no torch")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Refuse trainings in tests without the marker, and in the fixtures that they ask for."""
    if "torch" not in sys.modules or item.get_closest_marker("portable"):
        return (yield)
    from torch.optim.optimizer import register_optimizer_step_pre_hook

    def refuse_training(*_: Any) -> None:
        if item.originalname not in portable_tests(item.path):
            pytest.fail("it trains without the marker `portable`, see tests/portable/marks.py")

    watch = register_optimizer_step_pre_hook(refuse_training)
    try:
        return (yield)
    finally:
        watch.remove()


@pytest.fixture(autouse=True)
def _same_threads_for_every_test() -> None:
    """Give torch its number of threads back."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(THREADS)


@pytest.fixture(scope="session")
def toy_body() -> BodyModel:
    """A small closed body of round limbs, always at hand."""
    return build_toy_body()


@pytest.fixture(scope="session")
def baked_bodies() -> dict[str, BodyModel]:
    """The real bodies, which come with drapeline."""
    return {gender: load_body(free_body(gender)) for gender in GENDERS}
