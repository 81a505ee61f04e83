"""Run the workflow as a user does, in a copy of the project and in a process of its own."""

import multiprocessing
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

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


# Importing Snakemake takes longer than most plans: processes begin as copies of one that has it.
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    ["snakemake.cli", "pandas", "scipy.spatial.transform", "snakemake_executor_plugin_slurm"]
)


class Run(NamedTuple):
    """A finished process of Snakemake.

    Attributes:
        returncode: of the process.
        stdout: text.
        stderr: text.
    """

    returncode: int
    stdout: str
    stderr: str


def snakemake(project: Path, *arguments: str) -> Run:
    """Run `snakemake` in a project's folder, as continuous integration does; output is captured."""
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "out", Path(folder) / "err"
        process = SERVER.Process(target=_run, args=(project, arguments, out, err))
        process.start()
        process.join(timeout=3600)
        if process.exitcode is None:
            process.kill()
            process.join()
        return Run(process.exitcode, out.read_text(), err.read_text())


def _run(project: Path, arguments: tuple[str, ...], out: Path, err: Path) -> None:
    """In the process of its own: call the command line's entry point."""
    os.chdir(project)
    for stream, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), stream)
    sys.path[0] = ""
    sys.argv = ["snakemake", "--workflow-profile", PROFILE, *arguments]
    from snakemake.cli import main

    main()
