"""What a file's text imports, and what a program loads."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src"


def imported_modules(text: str) -> Iterator[str]:
    """Modules that a file imports anywhere, but for what only type checkers see."""
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Import(names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module):
                yield module
            case ast.If(test) if "TYPE_CHECKING" in ast.unparse(test):
                pass
            case ast.expr():  # holds no statements
                pass
            case _:
                waiting += ast.iter_child_nodes(node)


def loaded_modules(program: str) -> set[str]:
    """Modules that a process of its own has loaded after a program."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{program}\nprint(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(SOURCE)},
    )
    return set(done.stdout.split())
