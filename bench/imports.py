"""Processor time that the jobs of an experiment take to import their modules."""

import ast
import resource
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

SCRIPTS = Path(__file__).parents[1] / "scripts"
_REPEATS = 3


def job_counts(results: Path) -> Counter[str]:
    """Rule -> jobs that have run, by the files of their benchmarks."""
    files = (results / "benchmarks").rglob("*.tsv")
    return Counter(
        path.relative_to(results / "benchmarks").parts[0].removesuffix(".tsv") for path in files
    )


def imports_of(script: Path) -> str:
    """The imports at the top of a script, as code."""
    body = ast.parse(script.read_text()).body
    return "\n".join(
        ast.unparse(node) for node in body if isinstance(node, ast.Import | ast.ImportFrom)
    )


def import_seconds(code: str) -> float:
    """Least processor time of processes that execute some imports, without Python's own start."""
    return min(_seconds(code) for _ in range(_REPEATS)) - min(_seconds("") for _ in range(_REPEATS))


def _seconds(code: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def shares(results: Path) -> Iterator[tuple[str, int, float]]:
    """Rule, jobs and seconds of imports per job, for all rules that have run."""
    for rule, jobs in sorted(job_counts(results).items()):
        script = SCRIPTS / f"{rule}.py"
        if script.is_file():
            yield rule, jobs, import_seconds(imports_of(script))


def sentence(results: Path) -> str:
    """The sum over all jobs, and the rules with the largest shares."""
    found = sorted(shares(results), key=lambda row: -row[1] * row[2])
    total = sum(jobs * seconds for _, jobs, seconds in found)
    most = "; ".join(
        f"`{rule}` {jobs * seconds:.0f} s ({jobs} x {seconds:.2f} s)"
        for rule, jobs, seconds in found[:6]
    )
    count = sum(jobs for _, jobs, _ in found)
    return f"The {count} jobs of the experiment take {total:.0f} s to import their modules: {most}."
