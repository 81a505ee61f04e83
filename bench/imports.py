"""Processor time that the jobs of an experiment take to import their modules."""

import ast
import resource
import subprocess
import sys
from collections import Counter
from pathlib import Path

SCRIPTS = Path(__file__).parents[1] / "scripts"
PACKAGES = ("torch", "pytorch_lightning")


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


def import_seconds(code: str) -> tuple[float, list[str]]:
    """Processor time of a process that executes some imports; the modules that it then has."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys\nprint(*sys.modules)"],
        check=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, done.stdout.split()


def without_ours(modules: list[str]) -> str:
    """Imports of the packages of others among some modules, as code.

    A module that its own package has to import first, or that is none of a file, is left out.
    """
    others = [name for name in modules if name.split(".")[0] not in ("drapeline", "__main__")]
    return f"""
import importlib
for name in {others}:
    try:
        importlib.import_module(name)
    except ImportError:
        pass
"""


def sentence(results: Path) -> str:
    """The sum over all jobs, and how much of it is that of the two slowest packages."""
    jobs, total, others, users = 0, 0.0, 0.0, Counter[str]()
    for rule, count in job_counts(results).items():
        script = SCRIPTS / f"{rule}.py"
        if script.is_file():
            seconds, modules = import_seconds(imports_of(script))
            jobs, total = jobs + count, total + count * seconds
            others += count * import_seconds(without_ours(modules))[0]
            users.update({name: count for name in PACKAGES if name in modules})
    torch, both = (
        import_seconds(f"import {name}")[0]
        for name in ("torch", "drapeline.models.training.lightning")
    )
    return (
        f"The {jobs} jobs of the experiment take {total:.0f} s to import their modules; the goal is"
        f" 80 s. Third-party packages account for nearly all of it: {others:.0f} s on their own."
        f" `import torch` alone takes {users['torch']} of them {torch:.1f} s each, together"
        f" {users['torch'] * torch:.0f} s; Lightning takes {users['pytorch_lightning']} jobs"
        f" {both - torch:.1f} s more, most of it for `torch._dynamo`, which torch's optimisers"
        " import in any case."
    )
