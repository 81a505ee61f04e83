"""Tab-separated tables with a heading."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drapeline.errors import DamagedFile
from drapeline.storage import atomic_file, read_rows


def write_table(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as tab-separated values, with the columns of all rows in order of appearance."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    with atomic_file(path) as scratch, open(scratch, "w", newline="") as stream:
        writer = csv.DictWriter(
            stream, columns, restval="", delimiter="\t", lineterminator="\n", quotechar='"'
        )
        writer.writeheader()
        writer.writerows(
            {key: " ".join(str(value).split()) for key, value in row.items()} for row in rows
        )


def read_table(path: str | Path, columns: Iterable[str] = ()) -> list[dict[str, str]]:
    """Rows of a tab-separated table; a table without rows need not have columns.

    Args:
        path: the `.tsv`.
        columns: those that must be there.

    Raises:
        InputError: the file is missing, is no such table, or lacks a column.
    """
    heading, rows = read_rows(path, "a tab-separated table")
    missing = [column for column in columns if column not in heading]
    if rows and missing:
        raise DamagedFile(path, f"lacks column {', '.join(missing)}; it has {', '.join(heading)}")
    return rows
