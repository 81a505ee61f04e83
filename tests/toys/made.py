"""The tiny experiment, which takes minutes to make, made once."""

import os
from pathlib import Path


def made_tiny() -> Path | None:
    """The folder in which `make run CONFIG=tests/data/tiny.yaml` was run, if the user names one."""
    folder = os.environ.get("DRAPELINE_TINY")
    return Path(folder).resolve() if folder else None
