"""How the rules files build on one another, checked on the Python that Snakemake makes of them."""

import ast
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake.parser import parse
from snakemake.sourcecache import LocalSourceFile

from toys.snakemake_run import ROOT

# Each model's rules files start with the name of its folder.
MODELS = tuple(
    path.name
    for path in sorted((ROOT / "src/drapeline/models").iterdir())
    if path.is_dir() and path.name not in {"layers", "training", "pictures", "__pycache__"}
)


def compile_rules(path: Path) -> ast.Module:
    """The syntax tree of the Python code that a rules file stands for."""
    with open(path) as stream:
        cache = SimpleNamespace(open=lambda _: stream)
        code, _ = parse(LocalSourceFile(str(path)), SimpleNamespace(sourcecache=cache), {})
    return ast.parse(code)


def included(path: Path) -> Iterator[Path]:
    """A rules file and all that it includes, in the order in which their code ends."""
    for name in re.findall(r'^include: "(.*)"', path.read_text(), re.MULTILINE):
        yield from included(path.parent / name)
    yield path


FILES = list(included(ROOT / "Snakefile"))
TREES = {path: compile_rules(path) for path in FILES}


def definitions(tree: ast.Module) -> set[str]:
    """Functions and constants of a rules file, without what Snakemake makes of its rules."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("__rule_"):
            found.add(node.name)
        elif isinstance(node, ast.Assign):
            found |= {name.id for name in node.targets if isinstance(name, ast.Name)}
    return found


def used_names(tree: ast.Module) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def defined_elsewhere(path: Path, others: list[Path]) -> set[str]:
    return {name for other in others for name in definitions(TREES[other])} - definitions(
        TREES[path]
    )


def test_every_rules_file_is_included_once():
    assert sorted(FILES) == sorted([ROOT / "Snakefile", *(ROOT / "workflow/rules").glob("*.smk")])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_file_uses_a_name_of_a_later_one(path):
    later = FILES[FILES.index(path) + 1 :]
    assert not used_names(TREES[path]) & defined_elsewhere(path, later)


@pytest.mark.parametrize("model", MODELS)
def test_no_model_uses_a_name_of_another(model):
    own = [path for path in FILES if path.name.startswith(model)]
    others = [p for p in FILES if p.name.startswith(MODELS) and not p.name.startswith(model)]
    for path in own:
        assert not used_names(TREES[path]) & defined_elsewhere(path, others)


def test_no_name_is_defined_twice():
    seen: dict[str, str] = {}
    for path, tree in TREES.items():
        for name in definitions(tree):
            assert name not in seen, f"{name} is defined in {seen[name]} and in {path.name}"
            seen[name] = path.name


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_functions_of_rules_have_names(path):
    """Lambdas in rules are hard to read; helpers stand in the common files."""
    rules = [n for n in TREES[path].body if getattr(n, "name", "").startswith("__rule_")]
    for rule in rules:
        for decorator in rule.decorator_list:
            assert not any(isinstance(node, ast.Lambda) for node in ast.walk(decorator)), rule.name


def test_a_scheduler_that_is_asked_to_look_again_and_again_looks_once():
    text = (ROOT / "workflow/rules/common.smk").read_text()
    (source,) = re.findall(r"^def wake_once.*?(?=^\S)", text, re.DOTALL | re.MULTILINE)
    names = {"threading": threading, "time": time}
    exec(source, names)
    scheduler = SimpleNamespace(_open_jobs=threading.Semaphore(0))
    for _ in range(5):
        names["wake_once"](scheduler, 1)
    assert scheduler._open_jobs.acquire(timeout=10)
    assert not scheduler._open_jobs.acquire(timeout=2)
    names["wake_once"](scheduler, 1)
    assert scheduler._open_jobs.acquire(timeout=10)
