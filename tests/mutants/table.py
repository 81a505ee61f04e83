"""The table of mutants, and which tests should notice each."""

import ast
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from toys.imported_modules import imported_modules

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "drapeline"
TESTS = ROOT / "tests"
TABLE = Path(__file__).with_name("mutants.toml")


@dataclass(frozen=True)
class Mutant:
    """One deliberate fault.

    Attributes:
        file: relative to the package.
        text: occurs exactly once in the file.
        put: what stands there instead.
        breaks: what is wrong then, in one line.
        tests: files under `tests` that may notice it, in this order; if empty, the file's mirrored
            test file and then every unit test file that imports the module.
    """

    file: str
    text: str
    put: str
    breaks: str
    tests: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.file}:{self.line}  {self.breaks}"

    @property
    def module(self) -> str:
        """Dotted name of the mutated module."""
        return "drapeline." + self.file.removesuffix(".py").replace("/", ".")

    @property
    def line(self) -> int:
        """Line of the file at which the text begins."""
        source = (PACKAGE / self.file).read_text()
        return source.count("\n", 0, source.index(self.text)) + 1

    def applied(self) -> str:
        """The file's text with the fault in it.

        Raises:
            ValueError: the text is not there exactly once.
            SyntaxError: the result is no Python.
        """
        source = (PACKAGE / self.file).read_text()
        if (count := source.count(self.text)) != 1:
            raise ValueError(f"{self.file}: {self.text!r} is there {count} times, expected once")
        mutated = source.replace(self.text, self.put)
        ast.parse(mutated)
        return mutated

    def test_files(self) -> list[Path]:
        """The test files to run, those most likely to notice first.

        Raises:
            FileNotFoundError: a file that the table names is not there, or there is none at all.
        """
        files = [TESTS / name for name in self.tests] or self._derived()
        for path in files or [self._mirror()]:
            if not path.is_file():
                raise FileNotFoundError(f"{path}: no such file, named for {self.file}")
        return files

    def _mirror(self) -> Path:
        path = TESTS / "unit" / self.file
        return path.with_name(f"test_{path.name}")

    def _derived(self) -> list[Path]:
        mirror = self._mirror()
        importers = [
            path
            for path in sorted((TESTS / "unit").rglob("test_*.py"))
            if self.module in _imports(path) and path != mirror
        ]
        return [mirror] * mirror.is_file() + importers


@cache
def _imports(path: Path) -> frozenset[str]:
    return frozenset(imported_modules(path.read_text()))


def load_mutants() -> list[Mutant]:
    """The table, in its order."""
    rows = tomllib.loads(TABLE.read_text())["mutant"]
    return [Mutant(**{**row, "tests": tuple(row.get("tests", ()))}) for row in rows]
