"""Does the suite notice faults? Plant each of the table's in a copy of the source and run tests.

`make mutants` runs it. A mutant whose tests fail is killed; one that they pass has survived, and
shows what no test checks. The checkout is never written to.
"""

import argparse
import multiprocessing
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from mutants.table import PACKAGE, ROOT, TESTS, Mutant, load_mutants

LIMIT_S = 600  # a mutant that takes longer hangs
LEAST_KILLED = 0.95
# What takes long to import and is none of ours: imported once, then every run is a fork.
_PRELOADED = [
    "pytest",
    "igl",
    "scipy.optimize",
    "scipy.spatial",
    "skimage.measure",
    "torch",
    "warp",
]
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", re.MULTILINE)


class Verdict(NamedTuple):
    """What became of a mutant.

    Attributes:
        mutant: which one.
        outcome: "killed", "killed: hangs", "killed: crashes", "SURVIVED", or "NOT TESTED" if none
            of its tests imports the module.
        test: the test that failed first, or "".
        seconds: of its run.
    """

    mutant: Mutant
    outcome: str
    test: str
    seconds: float


def run_tests(source: Path, module: str, tests: Sequence[str]) -> tuple[int | None, str]:
    """Run tests on a copy of the source until one fails.

    Args:
        source: folder that holds the package's folder.
        module: that must have been imported if all tests pass.
        tests: files or single tests.

    Returns:
        pytest's exit code, None if it ran into the time limit, and what it printed.
    """
    output = source.with_suffix(".txt")
    process = multiprocessing.get_context("forkserver").Process(
        target=_pytest, args=(source, module, tests, output)
    )
    process.start()
    process.join(LIMIT_S)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)  # with all that a test has started
        process.join()
        return None, ""
    return process.exitcode, output.read_text()


def _pytest(source: Path, module: str, tests: Sequence[str], output: Path) -> None:
    """The work of a process of its own."""
    os.setsid()
    with open(output, "w") as stream:
        for descriptor in (1, 2):
            os.dup2(stream.fileno(), descriptor)
    os.chdir(ROOT)
    os.environ.update(
        PYTHONPATH=os.pathsep.join(map(str, (source, TESTS))),
        PYTHONDONTWRITEBYTECODE="1",
        MUTATED_SOURCE=str(source),
        MUTATED_MODULE=module,
    )
    sys.path[:0] = [str(source), str(TESTS)]
    sys.dont_write_bytecode = True
    import pytest

    options = ["-q", "-x", "-rfE", "--no-header", "--tb=no", "-p", "no:cacheprovider"]
    options += ["-p", "mutants.guard", "-o", f"pythonpath={source} {TESTS}"]
    sys.exit(pytest.main([*options, *tests]))


def copy_source(folder: Path) -> Path:
    """A copy of the package's source in a new folder within this one."""
    source = Path(tempfile.mkdtemp(dir=folder))
    shutil.copytree(PACKAGE, source / "drapeline", ignore=shutil.ignore_patterns("__pycache__"))
    return source


def try_mutant(mutant: Mutant, scratch: Path) -> Verdict:
    """Plant one fault in a copy of the source and see whether its tests notice."""
    start = time.monotonic()
    source = copy_source(scratch)
    (source / "drapeline" / mutant.file).write_text(mutant.applied())
    files = [str(path.relative_to(ROOT)) for path in mutant.test_files()]
    code, output = run_tests(source, mutant.module, files)
    shutil.rmtree(source)
    failed = _FAILED.search(output)
    if code is None:
        outcome = "killed: hangs"
    elif code < 0:
        outcome = "killed: crashes"
    elif code == 0:
        outcome = "SURVIVED"
    elif failed:
        outcome = "killed"
    else:
        outcome = "NOT TESTED"
    return Verdict(mutant, outcome, failed[1] if failed else "", time.monotonic() - start)


def refuse_tests_that_fail_anyway(verdicts: Sequence[Verdict], scratch: Path) -> None:
    """Run all tests that killed something on a copy without a fault.

    Raises:
        RuntimeError: one of them fails there too, so that it has noticed nothing.
    """
    tests = sorted({verdict.test for verdict in verdicts if verdict.test})
    if not tests:
        return
    code, output = run_tests(copy_source(scratch), "drapeline", tests)
    if code:
        raise RuntimeError(f"tests that kill mutants fail without them too:\n{output}")


def say(line: str) -> None:
    """One line of the report, at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    """Try the mutants asked for; the exit code says whether enough of them were killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="mutants tried at a time")
    parser.add_argument("--only", default="", help="part of the files' names")
    asked = parser.parse_args()
    mutants = [mutant for mutant in load_mutants() if asked.only in mutant.file]
    for mutant in mutants:
        mutant.applied()  # before hours are spent, not after
    os.environ["OMP_NUM_THREADS"] = "1"
    multiprocessing.set_forkserver_preload(_PRELOADED)
    start, verdicts = time.monotonic(), []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        scratch = Path(folder)
        for verdict in pool.map(lambda mutant: try_mutant(mutant, scratch), mutants):
            verdicts.append(verdict)
            say(f"{verdict.outcome:15}{verdict.seconds:5.0f} s  {verdict.mutant}")
            say(f"{'':24}{verdict.test.removeprefix('tests/')}")
        refuse_tests_that_fail_anyway(verdicts, scratch)
    survivors = [verdict for verdict in verdicts if not verdict.outcome.startswith("killed")]
    killed = len(verdicts) - len(survivors)
    say(f"\n{killed} of {len(verdicts)} mutants killed in {time.monotonic() - start:.0f} s")
    for verdict in survivors:
        say(f"{verdict.outcome}: {verdict.mutant}")
    return 0 if killed >= LEAST_KILLED * len(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
