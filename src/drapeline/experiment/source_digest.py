"""Which code a rule's script runs: a digest that changes when its results may change."""

import ast
import hashlib
import json
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from drapeline.errors import InputError
from drapeline.storage import read_json, write_json

PACKAGE = "drapeline"
DATA_SUFFIXES = {".html", ".yaml"}
FILE_NAME = re.compile(r"[\w.-]+")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Sources:
    """The package's files as they are now. Each is read once, since most serve many rules.

    Args:
        folder: holds the package's folder.
        memory: JSON file that keeps the parsed files from one run to the next, because parsing
            takes seconds; None keeps nothing. A file that cannot be read or written is ignored.
    """

    def __init__(self, folder: str | Path, memory: str | Path | None = None) -> None:
        self._folder = Path(folder)
        self._memory = None if memory is None else Path(memory)
        self._known = _load_memory(self._memory)
        self._used: dict[str, _Code] = {}
        self._data_files = [
            path
            for path in sorted((self._folder / PACKAGE).rglob("*"))
            if path.suffix in DATA_SUFFIXES
        ]
        self._code = cache(self._read_code)
        self._imports = cache(self._find_imports)
        self._data = cache(self._find_data)
        self._module_file = cache(self._find_module)

    def digest(self, script: str | Path, *named: str) -> str:
        """Digest of a script and of every file of the package that it uses.

        Comments, layout and docstrings do not count.

        Args:
            script: a Python file that imports from the package.
            named: dotted names of modules that it imports without naming them in its text.

        Returns:
            Twelve hexadecimal digits.

        Raises:
            FileNotFoundError: an import of the package names no module.
        """
        digest = hashlib.sha256(self._code(Path(script)).digest.encode())
        for path in sorted(self.imported_files(script, *named)):
            digest.update(path.name.encode())
            text = path.suffix == ".py"
            digest.update(self._code(path).digest.encode() if text else path.read_bytes())
        return digest.hexdigest()[:12]

    def imported_files(self, script: str | Path, *named: str) -> set[Path]:
        """Files of the package that a script uses.

        They are the modules it imports, directly or through others, and the data files (YAML, HTML)
        beside or below such a module that the module names: by their own name or by that of a
        folder that holds them.

        Args:
            script: a Python file that imports from the package.
            named: dotted names of modules that it imports without naming them in its text.
        """
        modules = {self._existing_file(module) for module in named}
        waiting = [Path(script), *modules]
        while waiting:
            for module in self._imports(waiting.pop()):
                if module not in modules:
                    modules.add(module)
                    waiting.append(module)
        return modules.union(*map(self._data, modules))

    def remember(self) -> None:
        """Keep what was parsed for the next run."""
        if self._memory is None or self._used.keys() <= self._known.keys():
            return
        with suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            write_json(self._memory, {"sum": _sum(self._used), "files": self._used})

    def _read_code(self, path: Path) -> "_Code":
        text = path.read_text()
        # Different interpreters print the same code differently.
        key = hashlib.sha256(f"{sys.version_info} {text}".encode()).hexdigest()
        self._used[key] = self._known.get(key) or _parse(text)
        return self._used[key]

    def _find_imports(self, path: Path) -> list[Path]:
        found = []
        for module, inner in self._code(path).imports:
            # `from drapeline.outfits import static` may name a module rather than a function.
            names = [f"{module}.{name}" for name in inner]
            for name in [n for n in names if self._module_file(n)] or [module]:
                found.append(self._existing_file(name))
        return found

    def _find_data(self, module: Path) -> list[Path]:
        names = self._code(module).names
        return [
            path
            for path in self._data_files
            if path.is_relative_to(module.parent)
            and not set(names).isdisjoint(path.relative_to(module.parent).parts)
        ]

    def _existing_file(self, module: str) -> Path:
        file = self._module_file(module)
        if file is None:
            raise FileNotFoundError(f"{module}: no such module under {self._folder}")
        return file

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


class _Code(NamedTuple):
    """What counts of a Python file.

    Attributes:
        digest: of the code without docstrings.
        imports: from the package.
        names: string constants that may name a file or a folder.
    """

    digest: str
    imports: tuple[_Import, ...]
    names: tuple[str, ...]


def _parse(text: str) -> _Code:
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    imports: list[_Import] = []
    names = set()
    unseen = _type_checking_nodes(nodes)
    for node in nodes:
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            unseen.update(id(inner) for inner in ast.walk(node.body[0]))
            node.body[0] = ast.Pass()
    for node in nodes:
        if id(node) in unseen:
            continue
        if isinstance(node, ast.Import):
            imports += [_Import(alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports.append(_Import(node.module, tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value)
    return _Code(
        hashlib.sha256(ast.unparse(tree).encode()).hexdigest(),
        tuple(i for i in imports if i.module.split(".")[0] == PACKAGE),
        tuple(sorted(filter(FILE_NAME.fullmatch, names))),
    )


def _type_checking_nodes(nodes: Iterable[ast.AST]) -> set[int]:
    """Identities of the nodes that only type checkers see."""
    return {
        id(inner)
        for node in nodes
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for statement in node.body
        for inner in ast.walk(statement)
    }


def _load_memory(memory: Path | None) -> dict[str, _Code]:
    if memory is None:
        return {}
    try:
        kept = read_json(memory, {"sum": str, "files": dict})
    except InputError:
        return {}
    if kept["sum"] != _sum(kept["files"]):  # damaged: the files are parsed anew
        return {}
    return {
        key: _Code(
            digest, tuple(_Import(module, tuple(inner)) for module, inner in imports), tuple(names)
        )
        for key, (digest, imports, names) in kept["files"].items()
    }


def _sum(files: dict[str, Any]) -> str:
    # With the names of the fields, so that what an older version kept is not taken for ours.
    text = json.dumps([_Import._fields, _Code._fields, files])
    return hashlib.sha256(text.encode()).hexdigest()
