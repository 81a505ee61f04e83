"""Which code a rule script runs: a digest that changes when the result may change."""

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

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
    digest = hashlib.sha256(_code(Path(script)).encode())
    for path in sorted(imported_files(Path(script), Path(source))):
        digest.update(path.name.encode())
        digest.update(_code(path).encode() if path.suffix == ".py" else path.read_bytes())
    return digest.hexdigest()[:12]


def imported_files(script: Path, source: Path) -> set[Path]:
    """Files of the package that `script` imports, directly or through others."""
    found: set[Path] = set()
    waiting = [script]
    while waiting:
        tree = ast.parse(waiting.pop().read_text())
        for module in _package_imports(tree, source):
            if module not in found:
                found.add(module)
                waiting.append(module)
    folders = {path.parent for path in found if path.parent != source / PACKAGE}
    data = {p for folder in folders for p in folder.rglob("*") if p.suffix in DATA_SUFFIXES}
    return found | data


def _package_imports(tree: ast.AST, source: Path) -> Iterator[Path]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            # `from drapeline.outfits import cuts` may name a module rather than a function.
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [n for n in inner if _module_file(n, source)] or [node.module]
        else:
            continue
        for name in names:
            if name.split(".")[0] == PACKAGE:
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


def _code(path: Path) -> str:
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body[0] = ast.Pass()
    return ast.unparse(tree)
