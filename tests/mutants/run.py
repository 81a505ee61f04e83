"""Which faults does the suite not notice? Plant some in copies of the source and run tests.

`make mutants` runs it. A mutant whose tests fail is killed; one that they pass has survived, and
shows what no test near it checks, or that nothing depends on it. The checkout is not written to.
"""

import argparse
import multiprocessing
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from mutants.operators import Mutant, mutants
from toys.reach import ROOT, TESTS, changed_files, tests_near

PACKAGE = ROOT / "src" / "drapeline"
LIMIT_S = 300  # a mutant that takes longer hangs
# Tests of a module are the nearest files, at most so many imports away.
FILES, IMPORTS = 12, 2
# What takes long to import and is none of ours: imported once, then every run is a fork.
_PRELOADED = [
    *("pytest", "igl", "scipy.optimize", "scipy.spatial", "skimage.measure", "torch", "warp"),
]
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", re.MULTILINE)


class Verdict(NamedTuple):
    """What became of a mutant.

    Attributes:
        outcome: "killed", "killed: hangs", "killed: crashes", "SURVIVED", or "NOT TESTED" if none
            of its tests imports the module.
        test: the test that failed first, or "".
        seconds: of its run.
    """

    outcome: str
    test: str
    seconds: float


def drawn_mutants(
    files: Sequence[Path], lines: dict[Path, set[int]] | None, count: int, seed: int
) -> Iterator[tuple[Path, Mutant]]:
    """Mutants of functions drawn at random, each function before any is drawn twice.

    Args:
        files: to draw from.
        lines: file -> numbers of the lines that a mutant may change; None stands for all.
        count: at most so many.
        seed: of the draw.
    """
    rng, functions = random.Random(seed), []
    for file in files:
        for found in mutants(file.read_text()).values():
            if kept := [m for m in found if lines is None or m.line in lines[file]]:
                functions.append((file, rng.sample(kept, len(kept))))
    while functions and count > 0:
        rng.shuffle(functions)
        for file, found in functions[:count]:
            yield file, found.pop()
        count -= len(functions)
        functions = [(file, found) for file, found in functions if found]


def changed_lines(commit: str, file: Path) -> set[int]:
    """Numbers of a file's lines that are not in a commit."""
    tracked = subprocess.run(["git", "cat-file", "-e", f"{commit}:{file.relative_to(ROOT)}"])
    if tracked.returncode:
        return {*range(1, len(file.read_text().splitlines()) + 1)}
    diff = subprocess.check_output(["git", "diff", "-U0", commit, "--", file], cwd=ROOT, text=True)
    found = re.findall(r"^@@ -\S+ \+(\d+)(?:,(\d+))? @@", diff, re.MULTILINE)
    return {int(start) + k for start, count in found for k in range(int(count or 1))}


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


def try_mutant(file: Path, mutant: Mutant, scratch: Path) -> Verdict:
    """Plant one fault in a copy of the source and see whether the nearest tests notice."""
    start = time.monotonic()
    near = [test for test, steps in tests_near([file]).items() if steps <= IMPORTS]
    unit = [str(test) for test in near if not test.is_relative_to(TESTS / "workflow")][:FILES]
    if not unit:
        return Verdict("NOT TESTED", "", 0.0)
    source, name = copy_source(scratch), file.relative_to(PACKAGE)
    (source / "drapeline" / name).write_text(mutant.text)
    code, output = run_tests(source, ".".join(("drapeline", *name.with_suffix("").parts)), unit)
    shutil.rmtree(source)
    failed = _FAILED.search(output)
    if code is None:
        outcome = "killed: hangs"
    elif code < 0:
        outcome = "killed: crashes"
    elif code == 0:
        outcome = "SURVIVED"
    else:
        outcome = "killed" if failed else "NOT TESTED"
    return Verdict(outcome, failed[1] if failed else "", time.monotonic() - start)


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


def main() -> None:
    """Try so many mutants and list those that survive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--changed", default="", help="commit since which a line has changed")
    parser.add_argument("--only", default="", help="part of the files' names")
    parser.add_argument("--count", type=int, default=60, help="mutants to try")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--jobs", type=int, default=2, help="mutants tried at a time")
    asked = parser.parse_args()
    files = changed_files(asked.changed) if asked.changed else sorted(PACKAGE.rglob("*.py"))
    files = [f for f in files if f.suffix == ".py" and f.is_relative_to(PACKAGE)]
    files = [f for f in files if asked.only in str(f.relative_to(PACKAGE))]
    lines = {f: changed_lines(asked.changed, f) for f in files} if asked.changed else None
    drawn = list(drawn_mutants(files, lines, asked.count, asked.seed))
    os.environ["OMP_NUM_THREADS"] = "1"
    multiprocessing.set_forkserver_preload(_PRELOADED)
    start, verdicts, survivors = time.monotonic(), [], []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        scratch = Path(folder)
        for (file, m), verdict in zip(
            drawn, pool.map(lambda one: try_mutant(*one, scratch), drawn), strict=True
        ):
            verdicts.append(verdict)
            line = f"{file.relative_to(ROOT)}:{m.line} {m.place}: {m.before}  ->  {m.after}"
            say(f"{verdict.outcome:15}{verdict.seconds:5.0f} s  {line}")
            if verdict.test:
                say(f"{'':24}{verdict.test.removeprefix('tests/')}")
            if not verdict.outcome.startswith("killed"):
                survivors.append(f"{verdict.outcome}: {line}")
        refuse_tests_that_fail_anyway(verdicts, scratch)
    killed = len(verdicts) - len(survivors)
    say(f"\n{killed} of {len(verdicts)} mutants killed in {time.monotonic() - start:.0f} s")
    for line in survivors:
        say(line)


if __name__ == "__main__":
    main()
