"""Which code a rule script runs: a digest that changes when the result may change."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = "drapeline"
DATA_SUFFIXES = {".html", ".yaml"}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def source_digest(script: str | Path, source: str | Path) -> str:
    """Digest of a script and of all the package's modules that it imports, however deep.

    Comments, layout and docstrings do not count. Data files (YAML, HTML) beside an imported
    module, or in folders below it, count as part of it.

    Args:
        script: a Python file that imports from the package.
        source: the folder that holds the package's folder.

    Returns:
        Twelve hexadecimal digits.

    Raises:
        FileNotFoundError: an import of the package names no module.
    """
    digest = hashlib.sha256(_parsed(Path(script).read_text()).code.encode())
    for path in sorted(imported_files(Path(script), Path(source))):
        digest.update(path.name.encode())
        text = path.suffix == ".py"
        digest.update(_parsed(path.read_text()).code.encode() if text else path.read_bytes())
    return digest.hexdigest()[:12]


def imported_files(script: Path, source: Path) -> set[Path]:
    """Files of the package that `script` imports, directly or through others."""
    found: set[Path] = set()
    waiting = [script]
    while waiting:
        for module in _package_imports(_parsed(waiting.pop().read_text()).imports, source):
            if module not in found:
                found.add(module)
                waiting.append(module)
    folders = {path.parent for path in found if path.parent != source / PACKAGE}
    data = {p for folder in folders for p in folder.rglob("*") if p.suffix in DATA_SUFFIXES}
    return found | data


def _package_imports(imports: tuple["_Import", ...], source: Path) -> Iterator[Path]:
    for module, inner in imports:
        # `from drapeline.outfits import cuts` may name a module rather than a function.
        names = [f"{module}.{name}" for name in inner]
        for name in [n for n in names if _module_file(n, source)] or [module]:
            path = _module_file(name, source)
            if path is None:
                raise FileNotFoundError(f"{name}: no such module under {source}")
            yield path


def _module_file(name: str, source: Path) -> Path | None:
    base = source.joinpath(*name.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None


class _Import(NamedTuple):
    """A module of the package, and the names that are imported from it."""

    module: str
    names: tuple[str, ...]


class _Parsed(NamedTuple):
    """What a file's text comes to: its code without docstrings, and its imports of the package."""

    code: str
    imports: tuple[_Import, ...]


@cache  # a workflow asks for the digests of all its rules, and most share most of their modules
def _parsed(text: str) -> _Parsed:
    tree = ast.parse(text)
    imports: list[_Import] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [_Import(alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports.append(_Import(node.module, tuple(alias.name for alias in node.names)))
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body[0] = ast.Pass()
    ours = tuple(i for i in imports if i.module.split(".")[0] == PACKAGE)
    return _Parsed(ast.unparse(tree), ours)
