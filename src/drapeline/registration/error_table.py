"""Tables of registration errors: a row for each garment and measure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drapeline.storage import atomic_file

FILE_NAME = "metrics.tsv"  # beside registered garments
COLUMNS = ("garment", "name", "metric", "value", "unit")


class Measure(NamedTuple):
    """An error of one garment."""

    metric: str  # name, with its unit
    value: float
    unit: str


def error_rows(garment: str, name: str, measures: Sequence[Measure]) -> list[dict[str, Any]]:
    """Rows of the table for one garment, given its type and the name of its outfit or sample."""
    return [
        {"garment": garment, "name": name, "metric": m.metric, "value": m.value, "unit": m.unit}
        for m in measures
    ]


def write_errors(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows with the keys `COLUMNS` as tab-separated values, values with six digits."""
    with atomic_file(path) as scratch:
        lines = ["\t".join(COLUMNS)]
        for row in rows:
            lines.append(
                "\t".join([*(str(row[c]) for c in COLUMNS[:3]), f"{row['value']:.6g}", row["unit"]])
            )
        scratch.write_text("\n".join(lines) + "\n")
