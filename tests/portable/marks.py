"""Which tests another processor could decide otherwise.

A test is `portable` if it trains or compares floating-point numbers. `conftest.py` marks those that
show it in their code; one whose training is hidden in a script carries the marker itself, and fails
without it. `portable/run.py` runs them as other processors would.
"""

import ast
from functools import cache
from pathlib import Path

# Whoever uses any of these, or what is called `train_...`, trains or compares such numbers.
TELLING = {
    *("allclose", "approx", "assert_allclose", "fit", "isclose", "torch"),
    *("assert_a_step_lowers", "assert_learned_by_heart", "assert_mixed_precision_agrees"),
    "assert_true_gradients",
}
_TESTS = Path(__file__).parents[1]


@cache
def portable_tests(path: Path) -> frozenset[str]:
    """Names of a module's functions that train or compare floating-point numbers.

    By themselves, or by the functions and fixtures they use of the module and of `conftest.py`.
    """
    folders = [folder for folder in path.parents if folder.is_relative_to(_TESTS)]
    parts: dict[str, list[ast.AST]] = {}
    for file in (path, *(folder / "conftest.py" for folder in folders)):
        for part in ast.parse(file.read_text()).body if file.exists() else []:
            if isinstance(part, ast.FunctionDef | ast.ClassDef):
                parts.setdefault(part.name, []).append(part)
    used = {name: set().union(*map(_names, same)) for name, same in parts.items()}
    found = {name for name, names in used.items() if any(map(_is_telling, names))}
    found |= {name for name, same in parts.items() if any(map(_has_threshold, same))}
    while more := {name for name, names in used.items() if names & found} - found:
        found |= more
    return frozenset(found)


def _is_telling(name: str) -> bool:
    return name in TELLING or name.startswith("train_")


def _names(tree: ast.AST) -> set[str]:
    """What a function uses; rules that it runs are strings."""
    found = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                found.add(name)
            case ast.Constant(value=str(name)) if name.startswith("train_") or ":train" in name:
                found.add("train_" + name)
    return found


def _has_threshold(tree: ast.AST) -> bool:
    """Whether something is compared with a decimal number."""
    return any(
        isinstance(part, ast.Constant) and isinstance(part.value, float)
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        for part in ast.walk(node)
    )
