"""The dataset's tables and records as the report's figures need them."""

import csv
from collections.abc import Iterable
from pathlib import Path

from drapeline.dataset.record import SampleRecord, read_record
from drapeline.dataset.splits import SPLITS
from drapeline.errors import InputError


def read_table(path: str | Path, columns: Iterable[str] = ()) -> list[dict[str, str]]:
    """Rows of a tab-separated table; a table without rows need not have columns.

    Args:
        path: the `.tsv`.
        columns: those that must be there.

    Raises:
        InputError: the file is missing or lacks a column.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a tab-separated table")
    with open(path, newline="") as stream:
        reader = csv.DictReader(stream, delimiter="\t")
        rows = list(reader)
        found = reader.fieldnames or []
    missing = [column for column in columns if column not in found]
    if rows and missing:
        raise InputError(f"{path}: lacks column {', '.join(missing)}; it has {', '.join(found)}")
    return rows


def accepted_records(dataset: str | Path) -> list[SampleRecord]:
    """Records of the accepted samples of a collected dataset, by id.

    Raises:
        InputError: the folder is no dataset, or a record is unusable.
    """
    dataset = Path(dataset)
    folders = [path for split in SPLITS for path in (dataset / split).glob("*") if path.is_dir()]
    return sorted((read_record(folder) for folder in folders), key=lambda r: r.meta["id"])
