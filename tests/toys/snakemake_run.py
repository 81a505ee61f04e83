"""Run the workflow as a user does, in a copy of the project and in processes of its own."""

import multiprocessing
import os
import runpy
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PROFILE = ROOT / "workflow/profiles/ci"
PARTS = (
    *("Snakefile", "config.yaml", "profiles", "workflow", "scripts", "src", "envs", "examples"),
    "tests/data",
)


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


# Importing takes longer than most plans and jobs of tests: processes begin as copies of one that
# has started Snakemake, and jobs as copies of another that has imported what they need.
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    [
        *("toys.snakemake_started", "smart_open", "jsonschema", "nbformat"),
        *("pandas", "scipy.spatial", "scipy.ndimage"),
    ]
)
JOBS_NEED = ["snakemake.script", "scipy.optimize"]
# Worth its seconds only where many jobs run.
MANY_JOBS_NEED = [
    *("scipy.sparse.linalg", "trimesh", "warp", "matplotlib.pyplot", "pytorch_lightning"),
]


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


def snakemake(project: Path, *arguments: str, many_jobs: bool = False) -> Run:
    """Run `snakemake` in a folder, as continuous integration does; output is captured.

    Args:
        project: the folder.
        arguments: of the command line.
        many_jobs: whether so many jobs will run that it is worth seconds to import first what they
            need.
    """
    memory = project / ".snakemake" / "drapeline" / "sources.json"
    parsed = Path(_scratch().name) / memory.name
    if parsed.exists() and not memory.exists():
        memory.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(parsed, memory)
    run = _start(project, arguments, many_jobs)
    if memory.exists():
        shutil.copy(memory, parsed)
    return run


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    """Keeps what the first process has parsed of the package; each folder has its own copy."""
    return tempfile.TemporaryDirectory(prefix="drapeline-")


def _start(project: Path, arguments: tuple[str, ...], many_jobs: bool) -> Run:
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "out", Path(folder) / "err"
        given = (project, arguments, many_jobs, dict(os.environ), out, err)
        # The server, which starts with the first process, looks here for what it imports.
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]), prepend=os.pathsep)
            process = SERVER.Process(target=_run, args=given)
            process.start()
        process.join(timeout=3600)
        if process.exitcode is None:
            process.kill()
            process.join()
        return Run(process.exitcode, out.read_text(), err.read_text())


def _run(
    project: Path,
    arguments: tuple[str, ...],
    many_jobs: bool,
    environment: Mapping[str, str],
    out: Path,
    err: Path,
) -> None:
    """In a process of its own: call the command line's entry point."""
    _write_to(out, err)
    os.chdir(project)
    os.environ.clear()
    os.environ.update(environment)
    # Tests of Blender have added its folders, where a module with Blender's name is not Blender.
    blender = f"{os.sep}bpy{os.sep}"
    sys.path[:] = ["", *(path for path in sys.path[1:] if blender not in path)]
    sys.argv = ["snakemake", "--workflow-profile", str(PROFILE), *arguments]
    from snakemake.benchmark import benchmarked
    from snakemake.cli import main
    from snakemake.script import PythonScript

    SERVER.set_forkserver_preload([*JOBS_NEED, *(MANY_JOBS_NEED if many_jobs else [])])
    # As Snakemake sets them for jobs, but read when NumPy and torch are imported.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

    def execute_script(self: PythonScript, fname: str, edit: bool = False) -> None:
        # Processes that other threads start read exit codes away.
        done, end = SERVER.Pipe(duplex=False)
        process = SERVER.Process(target=_run_script, args=(fname, self.threads, out, err, end))
        process.start()
        end.close()
        with benchmarked(process.pid, self.bench_record):
            try:
                done.recv()
            except EOFError:
                raise subprocess.CalledProcessError(1, fname) from None

    PythonScript.execute_script = execute_script
    main()


def _run_script(file: str, threads: int, out: Path, err: Path, end: Connection) -> None:
    """In a process of its own: run what Snakemake wrote for a job, and say so at its end."""
    _write_to(out, err)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)
    sys.argv = [file]
    runpy.run_path(file, run_name="__main__")
    end.send("done")


def _write_to(out: Path, err: Path) -> None:
    for stream, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
