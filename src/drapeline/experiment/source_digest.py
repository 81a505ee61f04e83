"""Which code a rule script runs: a digest that changes when the result may change."""

import ast
import hashlib
import json
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from drapeline.storage import write_json

PACKAGE = "drapeline"
DATA_SUFFIXES = {".html", ".yaml"}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Sources:
    """The package's files as they are now; each is read once, for most are shared by many rules.

    Args:
        folder: holds the package's folder.
        memory: JSON file that keeps what texts come to from one run to the next, for parsing them
            takes seconds; None to keep nothing. One that cannot be read or written does no harm.
    """

    def __init__(self, folder: str | Path, memory: str | Path | None = None) -> None:
        self._folder = Path(folder)
        self._memory = None if memory is None else Path(memory)
        self._known = _remembered(self._memory)
        self._used: dict[str, _Parsed] = {}
        self._parsed = cache(self._parse)
        self._imports = cache(self._find_imports)
        self._module_file = cache(self._find_module)

    def digest(self, script: str | Path) -> str:
        """Digest of a script and of all the package's modules that it imports, however deep.

        Comments, layout and docstrings do not count. Data files (YAML, HTML) beside an imported
        module, or in folders below it, count as part of it.

        Args:
            script: a Python file that imports from the package.

        Returns:
            Twelve hexadecimal digits.

        Raises:
            FileNotFoundError: an import of the package names no module.
        """
        digest = hashlib.sha256(self._parsed(Path(script)).code.encode())
        for path in sorted(self.imported_files(script)):
            digest.update(path.name.encode())
            text = path.suffix == ".py"
            digest.update(self._parsed(path).code.encode() if text else path.read_bytes())
        return digest.hexdigest()[:12]

    def imported_files(self, script: str | Path) -> set[Path]:
        """Files of the package that `script` imports, directly or through others."""
        found: set[Path] = set()
        waiting = [Path(script)]
        while waiting:
            for module in self._imports(waiting.pop()):
                if module not in found:
                    found.add(module)
                    waiting.append(module)
        folders = {path.parent for path in found if path.parent != self._folder / PACKAGE}
        data = {p for folder in folders for p in folder.rglob("*") if p.suffix in DATA_SUFFIXES}
        return found | data

    def remember(self) -> None:
        """Keep what was found for the next run."""
        if self._memory is None or self._used.keys() <= self._known.keys():
            return
        with suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            write_json(self._memory, self._used)

    def _parse(self, path: Path) -> "_Parsed":
        text = path.read_text()
        # What code is printed as depends on the interpreter.
        key = hashlib.sha256(f"{sys.version_info} {text}".encode()).hexdigest()
        self._used[key] = self._known.get(key) or _parsed(text)
        return self._used[key]

    def _find_imports(self, path: Path) -> list[Path]:
        found = []
        for module, inner in self._parsed(path).imports:
            # `from drapeline.outfits import cuts` may name a module rather than a function.
            names = [f"{module}.{name}" for name in inner]
            for name in [n for n in names if self._module_file(n)] or [module]:
                file = self._module_file(name)
                if file is None:
                    raise FileNotFoundError(f"{name}: no such module under {self._folder}")
                found.append(file)
        return found

    def _find_module(self, name: str) -> Path | None:
        base = self._folder.joinpath(*name.split("."))
        for path in (base.with_suffix(".py"), base / "__init__.py"):
            if path.is_file():
                return path
        return None


class _Import(NamedTuple):
    """A module of the package, and the names that are imported from it."""

    module: str
    names: tuple[str, ...]


class _Parsed(NamedTuple):
    """What a text comes to: digest of the code without docstrings, imports of the package."""

    code: str
    imports: tuple[_Import, ...]


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
    return _Parsed(hashlib.sha256(ast.unparse(tree).encode()).hexdigest(), ours)


def _remembered(memory: Path | None) -> dict[str, _Parsed]:
    try:
        entries = {} if memory is None else json.loads(memory.read_text())
        return {
            key: _Parsed(code, tuple(_Import(module, tuple(names)) for module, names in imports))
            for key, (code, imports) in entries.items()
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
