"""Fixtures of the tests that run the workflow."""

from pathlib import Path

import pytest

from toys.snakemake_run import copy_project


@pytest.fixture(scope="session")
def project(tmp_path_factory) -> Path:
    """A copy of the project to plan runs in; its files are not to be changed."""
    return copy_project(tmp_path_factory.mktemp("project"))
