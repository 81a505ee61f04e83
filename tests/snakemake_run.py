"""Run the workflow as a user does, in a copy of the project and in a process of its own."""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROFILE = "workflow/profiles/ci"
PARTS = ("Snakefile", "config.yaml", "workflow", "scripts", "src", "envs", "tests/data")


def copy_project(folder: Path) -> Path:
    """Copy all that a run reads into a folder, so that nothing is written into the checkout."""
    # Compiled files may vanish while they are copied: other processes write them.
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in PARTS:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, ignore=ignored)
        else:
            shutil.copy2(ROOT / name, target)
    return folder


def snakemake(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `snakemake` in a project's folder, as continuous integration does; output is captured."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--workflow-profile", PROFILE, *arguments],
        cwd=project,
        capture_output=True,
        text=True,
        timeout=3600,
    )
