"""Run the workflow as a user does, in a process of its own."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROFILE = "workflow/profiles/ci"


def snakemake(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `snakemake` in the project's folder, as in continuous integration; output is captured."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--workflow-profile", PROFILE, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1200,
    )
