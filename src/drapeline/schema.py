"""Tables as pandas frames, in tab-separated files, with one declared schema each.

Importing pandas takes half a second: jobs that make no tables do not import this.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from drapeline.errors import DamagedFile, InputError
from drapeline.storage import atomic_file, read_rows, write_rows

Table: TypeAlias = pd.DataFrame
_KINDS: dict[type, type] = {int: np.int64, float: float}  # of numbers; a whole number has 64 bits
_WORDS = {str: "text", int: "a whole number", float: "a number"}
_UNMEASURED = frozenset({"", "-", "NA", "nan"})


class Column(NamedTuple):
    """A column of a table."""

    kind: type = str  # `str`, `int` or `float`
    allowed: Collection[str] = ()  # the only values, or nothing if there are others
    low: float = -math.inf  # the least value of a number
    optional: bool = False  # whether a number may be unknown: NaN in the frame, empty in a file
    text: str = ""  # format of a number in a file

    @property
    def expected(self) -> str:
        """Its values in words."""
        if self.allowed:
            return f"one of {', '.join(self.allowed)}"
        finite = "a finite number" if self.kind is float else _WORDS[self.kind]
        return finite if self.low == -math.inf else f"{finite}, at least {self.low:g}"

    def holds(self, values: pd.Series) -> pd.Series:
        """True for each value that may stand in the column."""
        if self.allowed:
            return values.isin(self.allowed)
        if self.kind is str:
            return values.map(lambda value: isinstance(value, str))
        good = values.map(math.isfinite) & (values >= self.low)
        return good | values.isna() if self.optional else good


class Schema(NamedTuple):
    """A table."""

    name: str  # such as "a table of metrics"
    columns: Mapping[str, Column]  # by name, in order
    key: tuple[str, ...] = ()  # columns that no two rows share the values of
    more: bool = False  # whether there may be further columns, of text


def make_table(schema: Schema, rows: Iterable[Mapping[str, Any]]) -> Table:
    """A frame of rows, with the schema's columns and types; what a row lacks is empty.

    Columns have the order of the schema or, where there may be more, that of the rows.
    """
    table = pd.DataFrame(list(rows))
    names = [*table.columns, *schema.columns] if schema.more else [*schema.columns, *table.columns]
    table = table.reindex(columns=list(dict.fromkeys(names)))
    for name, column in schema.columns.items():
        if column.kind is str:
            texts = table[name].astype(object)
            table[name] = texts.where(texts.notna(), "")
        else:
            table[name] = table[name].astype(column.kind)
    return table


def check_table(schema: Schema, table: Table, path: str | Path) -> Table:
    """The table itself, if it is one of the schema.

    Args:
        table: any frame.
        path: named in errors.

    Raises:
        InputError: a column is missing, or a value is not what its column holds; names the file,
            the row and the column.
    """
    _check_columns(schema, list(table.columns), path)
    for name, column in schema.columns.items():
        wrong = ~column.holds(table[name]).to_numpy(dtype=bool)
        if wrong.any():
            row = int(wrong.argmax())
            raise InputError(
                f"{_place(schema, table, row, path)}: {name} is '{table[name].iloc[row]}',"
                f" expected {column.expected}"
            )
    if schema.key:
        twice = table.duplicated(list(schema.key)).to_numpy()
        if twice.any():
            row = int(twice.argmax())
            raise InputError(f"{_place(schema, table, row, path)} is there twice, expected once")
    return table


def read_table(path: str | Path, schema: Schema) -> Table:
    """Read a table.

    Raises:
        InputError: the file is missing or not of the schema; names the file, line and column.
    """
    heading, rows = read_rows(path, schema.name)
    _check_columns(schema, heading, path)
    table = pd.DataFrame(rows, columns=heading, dtype=object)
    for name, column in schema.columns.items():
        if column.kind is not str:
            numbers = _numbers(path, name, table[name], column)
            table[name] = pd.Series(numbers, index=table.index, dtype=column.kind)
    return check_table(schema, table, path)


def write_table(path: str | Path, table: Table, schema: Schema) -> None:
    """Write a table.

    Raises:
        InputError: it is not of the schema.
    """
    texts = check_table(schema, table, path).astype(object)
    for name, column in schema.columns.items():
        if column.kind is not str:
            form = f"{{:{column.text}}}".format
            texts[name] = ["" if pd.isna(value) else form(value) for value in table[name]]
    write_rows(path, texts.to_dict("records"), table.columns)


def write_parquet(path: str | Path, table: Table) -> None:
    """Write a table as Parquet.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    with atomic_file(path) as scratch:
        table.to_parquet(scratch, index=False)


def typed(table: Table, schema: Schema) -> Table:
    """A table whose columns that the schema does not name are numbers where all texts are.

    Empty ones become NaN.
    """
    found = {}
    for name in table:
        numbers = pd.to_numeric(table[name], errors="coerce")
        texts = numbers.isna() & ~table[name].isin(_UNMEASURED)
        found[name] = table[name] if name in schema.columns or texts.any() else numbers
    return pd.DataFrame(found)


def _check_columns(schema: Schema, found: list[str], path: str | Path) -> None:
    missing = [name for name in schema.columns if name not in found]
    if missing:
        raise DamagedFile(
            path, f"lacks column {', '.join(missing)}; it has {', '.join(found) or 'none'}"
        )
    unknown = [] if schema.more else [name for name in found if name not in schema.columns]
    if unknown:
        raise DamagedFile(
            path, f"has column {', '.join(unknown)}, expected {', '.join(schema.columns)} alone"
        )


def _numbers(path: str | Path, name: str, texts: pd.Series, column: Column) -> list[float]:
    numbers = []
    for line, text in enumerate(texts, 2):
        try:
            unknown = column.optional and text in _UNMEASURED
            numbers.append(math.nan if unknown else _KINDS[column.kind](text))
        except (ValueError, OverflowError) as error:
            raise DamagedFile(
                path, f"line {line}: {name} is '{text:.80}', expected {_WORDS[column.kind]}"
            ) from error
    return numbers


def _place(schema: Schema, table: Table, row: int, path: str | Path) -> str:
    key = " ".join(str(table[name].iloc[row]) for name in schema.key)
    return f"{path}: line {row + 2}{f' ({key})' if key else ''}"
