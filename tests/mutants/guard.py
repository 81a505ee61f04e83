"""Pytest plugin of the mutation run: what was tested is the mutated copy, all of it."""

import os
import sys
from pathlib import Path

import pytest


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Refuse a run whose modules came from elsewhere, or that passed without the mutated one."""
    source = Path(os.environ["MUTATED_SOURCE"])
    ours = {name: m for name, m in sys.modules.items() if name.split(".")[0] == "drapeline"}
    for name, module in ours.items():
        if not Path(module.__file__).is_relative_to(source):
            raise pytest.UsageError(f"{name} came from {module.__file__}, expected {source}")
    if exitstatus == pytest.ExitCode.OK and os.environ["MUTATED_MODULE"] not in ours:
        raise pytest.UsageError(f"no test imported {os.environ['MUTATED_MODULE']}")
