"""What workflow/config/paper.yaml takes from the papers."""

from pathlib import Path
from typing import Any

import yaml

PAPER = Path(__file__).parents[2] / "workflow/config/paper.yaml"


def printed(path: str) -> dict[str, Any]:
    """What it names of a group of settings, by the group's dotted path."""
    found = yaml.safe_load(PAPER.read_text())
    for key in path.split("."):
        found = found[key]
    return found
