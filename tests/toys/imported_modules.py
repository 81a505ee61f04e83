"""What a file's text imports."""

import ast
from collections.abc import Iterator


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
