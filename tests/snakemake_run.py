"""Run the workflow as a user does, in a process of its own."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def snakemake(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `snakemake --cores all` in the project's folder; output is captured."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "all", "--rerun-incomplete", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1200,
    )
