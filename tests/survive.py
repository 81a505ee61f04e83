"""Kill the tiny experiment, or fill its disk, at random moments; the results must be the same.

    PYTHONPATH=src:tests python tests/survive.py kills FOLDER [--times 100] [--target all]
    PYTHONPATH=src:tests python tests/survive.py full-disk FOLDER [--times 10] [--target all]

FOLDER gets `reference`, one undisturbed run that later calls use again, and copies of the project
that are disturbed, started again with what the documentation says to type, and disturbed again
until they are finished. Prints a line for each disturbance, then counts: arrays that differ from
those of the undisturbed run, files of killed jobs that are left over, and tracebacks on the
terminal. Exits with 1 if there is any of the first two. `full-disk` needs root, to mount a file
system in memory on the folder of results. Takes minutes per run of the experiment; CI does not run
it.
"""

import argparse
import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import psutil

from compare_results import array_hashes, differences
from toys.snakemake_run import ROOT, copy_project

SNAKEMAKE = ROOT / ".venv/bin/snakemake"
CONFIG = ["--configfile", "tests/data/tiny.yaml"]
RUN = ["--cores", "2", "--keep-going", *CONFIG]
RESULTS = "results/tiny"
LONGEST_S = 3600
Disturb = Callable[[Path, "subprocess.Popen[bytes]"], str]


class Counts(NamedTuple):
    """What a finished project shows after its disturbances."""

    disturbed: int
    different: int
    leftovers: int
    tracebacks: int


def start(project: Path, arguments: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Snakemake in a project, in a session of its own; it writes to `output.txt`."""
    with open(project / "output.txt", "ab") as stream:
        return subprocess.Popen(
            [SNAKEMAKE, *arguments],
            cwd=project,
            stdout=stream,
            stderr=stream,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": "", "OMP_NUM_THREADS": "1"},
        )


def reference(folder: Path) -> Path:
    """A project that was never disturbed, with its baked bodies."""
    project = folder / "reference"
    if not (project / "done").exists():
        shutil.rmtree(project, ignore_errors=True)
        project.mkdir(parents=True)
        copy_project(project)
        began = time.monotonic()
        if start(project, ["all", *RUN]).wait(LONGEST_S):
            sys.exit(f"the undisturbed run failed, see {project}/output.txt")
        (project / "done").write_text(f"{time.monotonic() - began:.0f} s\n")
    return project


def fresh(folder: Path, name: str) -> Path:
    """A copy of the project without results. Bodies are as in the reference: they take minutes."""
    project = folder / name
    shutil.rmtree(project, ignore_errors=True)
    project.mkdir()
    copy_project(project)
    shutil.copytree(folder / "reference/resources", project / "resources")
    return project


def disturb_until_done(project: Path, target: str, disturb: Disturb, most: int) -> int:
    """Run a project, disturbing it up to so many times, until the target is made."""
    count = 0
    while True:
        # What the documentation says to type after a kill.
        unlock = subprocess.run(
            [SNAKEMAKE, "--unlock", *CONFIG], cwd=project, capture_output=True, text=True
        )
        if unlock.returncode:
            sys.exit(f"--unlock failed: {unlock.stderr[-500:]}")
        process = start(project, [target, *RUN])
        if count == most:
            if process.wait(LONGEST_S):
                sys.exit(f"the last run was not disturbed and failed, see {project}/output.txt")
            return count
        what = disturb(project, process)
        if not what and process.wait(LONGEST_S) == 0:
            return count
        if what:
            count += 1
            say(f"{project.name}, {count}: {what}")


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def examine(folder: Path, project: Path, target: str, disturbed: int) -> Counts:
    """Compare a finished project with the undisturbed one."""
    whole, found = (array_hashes(path / RESULTS) for path in (folder / "reference", project))
    if target != "all":
        whole = {name: value for name, value in whole.items() if name in found}
    different = differences(whole, found)
    leftovers = list(project.rglob(".writing-*"))
    for line in (*different[:20], *leftovers):
        say(f"  {line}")
    text = (project / "output.txt").read_text(errors="replace")
    counts = Counts(disturbed, len(different), len(leftovers), text.count("Traceback"))
    say(f"{project.name}: {len(whole)} arrays compared, {counts}")
    return counts


# ---- kills -----------------------------------------------------------------------------------


def killer(rng: random.Random, longest_s: float) -> Disturb:
    """Kills everything, Snakemake alone so that its jobs go on beside the next ones, or one job."""

    def kill(_: Path, process: "subprocess.Popen[bytes]") -> str:
        wait_s = rng.uniform(1, longest_s)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)
            return ""
        victim = rng.choice(["everything", "everything", "Snakemake alone", "one job"])
        jobs = psutil.Process(process.pid).children(recursive=True)
        if victim == "everything":
            os.killpg(process.pid, signal.SIGKILL)
        elif victim == "Snakemake alone":
            process.kill()
        elif not jobs:
            return "" if process.wait(LONGEST_S) == 0 else "no job to kill"
        else:
            with contextlib.suppress(psutil.NoSuchProcess):
                rng.choice(jobs).kill()
        process.wait(LONGEST_S)
        _, running = psutil.wait_procs(jobs, timeout=1)
        return f"{victim} killed after {wait_s:.1f} s; {len(running)} processes go on"

    return kill


# ---- full disk -------------------------------------------------------------------------------


def filler(rng: random.Random, longest_s: float) -> Disturb:
    """Fills the disk but for a few kB until Snakemake gives up, then frees it again."""

    def fill(project: Path, process: "subprocess.Popen[bytes]") -> str:
        wait_s = rng.uniform(1, longest_s)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)
            return ""
        before = (project / "output.txt").stat().st_size
        left = rng.choice([0, 0, 4096, 100_000, 1_000_000])
        weight = project / "results" / "weight"
        with open(weight, "wb") as stream:
            while (room := shutil.disk_usage(weight.parent).free) > left:
                with contextlib.suppress(OSError):  # jobs are writing as well
                    start_at = os.fstat(stream.fileno()).st_size
                    os.posix_fallocate(stream.fileno(), start_at, max((room - left) // 2, 1))
        code = process.wait(LONGEST_S)
        weight.unlink()
        said = (project / "output.txt").read_bytes()[before:].decode(errors="replace")
        sentences = set(re.findall(r"^drapeline: .*", said, re.MULTILINE))
        return (
            f"{left} bytes left after {wait_s:.1f} s: exit {code}, {said.count('Traceback')}"
            f" tracebacks, {len(sentences)} sentences, such as {min(sentences, default='none')!r}"
        )

    return fill


@contextlib.contextmanager
def small_disk(project: Path) -> Iterator[None]:
    """A disk of its own for the results of a project."""
    results = project / "results"
    results.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1g", "tmpfs", results], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", results], check=True)


@contextlib.contextmanager
def own_disk(project: Path) -> Iterator[None]:
    """The project's own disk, as it is."""
    yield


# Way -> what disturbs, the disk that results are on, the name of projects, and how many times.
WAYS = {
    "kills": (killer, own_disk, "killed", 100),
    "full-disk": (filler, small_disk, "filled", 10),
}


def disturbed_projects(
    folder: Path, way: str, target: str, times: int, rng: random.Random, longest_s: float
) -> Iterator[Counts]:
    """Disturb projects, one after the other, so many times altogether."""
    disturb, disk, name, _ = WAYS[way]
    number, left = 0, times
    while left > 0:
        number += 1
        project = fresh(folder, f"{name}_{number}")
        with disk(project):
            done = disturb_until_done(project, target, disturb(rng, longest_s), left)
            left -= done
            yield examine(folder, project, target, done)
        if not done:
            break


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("way", choices=WAYS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--target", default="all")
    parser.add_argument("--times", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=float, default=60, help="seconds until a disturbance")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    say(f"undisturbed run: {(reference(folder) / 'done').read_text().strip()}")
    rng = random.Random(given.seed)
    times = given.times or WAYS[given.way][3]
    rounds = list(disturbed_projects(folder, given.way, given.target, times, rng, given.longest))
    total = Counts(*(sum(column) for column in zip(*rounds, strict=True)))
    say(f"{len(rounds)} runs of the experiment: {total}")
    return 1 if total.different or total.leftovers else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
