"""Which tests a change of a file can reach, and how near they are to it."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
# Read as text, since to parse a thousand files takes longer than many a test.
IMPORT = re.compile(r"^ *(?:from ([\w.]+) import ((?:\([^)]*\))|.*)|import ([\w.]+))", re.MULTILINE)
NAMED = re.compile(r"\"([\w./-]+)\"")
# What a test that runs Snakemake reads beside the library.
WORKFLOW = ("Snakefile", "config.yaml", "workflow", "scripts", "examples", "tests/data")


def changed_files(commit: str) -> list[Path]:
    """Files that differ from those of a commit, new ones included."""
    commands = (
        ["git", "diff", "--name-only", "--diff-filter=d", commit],
        ["git", "ls-files", "--others", "--exclude-standard"],
    )
    return [
        ROOT / line
        for command in commands
        for line in subprocess.check_output(command, cwd=ROOT, text=True).splitlines()
    ]


def tests_near(changed: Iterable[Path]) -> dict[Path, int]:
    """Test files that the changed files can reach -> imports between, the nearest first.

    Of two that are equally near, the one that uses fewer files comes first.
    """
    changed, found = set(changed), {}
    for test in sorted(TESTS.glob("*/**/test_*.py")):
        distances = _distances(test)
        steps = [distances[path] for path in changed & distances.keys()]
        if steps:
            found[test] = min(steps)
    return dict(sorted(found.items(), key=lambda item: (item[1], len(_distances(item[0])))))


@cache
def _distances(file: Path) -> dict[Path, int]:
    """Files that one uses, itself included -> imports between."""
    found, border, steps = {file: 0}, [file], 0
    while border:
        steps += 1
        border = list({used for path in border for used in _used(path)} - found.keys())
        found.update(dict.fromkeys(border, steps))
    return found


@cache
def _used(file: Path) -> frozenset[Path]:
    return frozenset(_find_used(file)) - {file} if file.suffix == ".py" else frozenset()


def _find_used(file: Path) -> Iterator[Path]:
    """Modules that a file imports, scripts of the rules it runs, files and folders it names."""
    text = file.read_text()
    for module, names, plain in IMPORT.findall(text):
        places = [f"{module}.{name}" for name in re.findall(r"\w+", names)]
        for place in {module or plain, *places}:
            for folder in (ROOT / "src", TESTS):
                path = folder / f"{place.replace('.', '/')}.py"
                if path in _files():
                    yield path
    if not file.name.startswith("test_"):
        return
    for rule in re.findall(r'run_rule\(\s*"(\w+)"', text):
        yield ROOT / "scripts" / f"{rule}.py"
    named = {*NAMED.findall(text), *(WORKFLOW if "toys.snakemake_run" in text else ())}
    for name in named:
        yield from _files().get(ROOT / name, ())


@cache
def _files() -> dict[Path, list[Path]]:
    """Every file and folder of the project -> the files that it holds."""
    found: dict[Path, list[Path]] = {}
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    for line in subprocess.check_output(listed, cwd=ROOT, text=True).splitlines():
        for part in [Path(line), *Path(line).parents[:-1]]:
            found.setdefault(ROOT / part, []).append(ROOT / line)
    return found
