"""Errors of garment -> offsets -> garment, summarised by garment type."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from drapeline.dataset.tables import read_table, write_table
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.error_table import COLUMNS, FILE_NAME
from drapeline.report.html import Cell, html_table, write_page

TARGET_MM = 3.0
# Metrics of which the sum, or the largest value, over garments is shown instead of the mean.
_SUMMED = {"holes_before", "islands_before", "holes_after", "islands_after"}
_LARGEST = {"garment_to_rebuilt_max_mm", "rebuilt_to_garment_max_mm"}
_BOUNDED = {
    "garment_to_rebuilt_mean_mm": TARGET_MM,
    "rebuilt_to_garment_mean_mm": TARGET_MM,
    "holes_after": 0,
    "islands_after": 0,
}


def summarise_errors(rows: Iterable[dict[str, str]], source: str) -> list[dict[str, str]]:
    """Summarise errors to a row per type and metric: mean, median, maximum and sum over garments.

    Args:
        rows: of an error table.
        source: "static" or "samples".
    """
    found: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for row in rows:
        found[row["garment"], row["metric"], row["unit"]].append(float(row["value"]))
    order = {name: index for index, name in enumerate(GARMENTS)}
    return [
        {
            "source": source,
            "garment": garment,
            "metric": metric,
            "garments": str(len(values)),
            "mean": f"{np.mean(values):.4g}",
            "median": f"{np.median(values):.4g}",
            "max": f"{np.max(values):.4g}",
            "total": f"{np.sum(values):.6g}",
            "unit": unit,
        }
        for (garment, metric, unit), values in sorted(
            found.items(), key=lambda item: order[item[0][0]]
        )
    ]


def write_registration_tables(
    table: str | Path, page: str | Path, *, static: Sequence[str], samples: Sequence[str]
) -> None:
    """Write the summary as `.tsv` and as a page.

    Args:
        table: the `.tsv`.
        page: the HTML page.
        static: `.tsv` of every shard.
        samples: folder of every registered sample; those of rejected ones have no table.

    Raises:
        InputError: a table is missing or lacks a column.
    """
    tables = [path for path in (Path(s) / FILE_NAME for s in samples) if path.is_file()]
    parts = {
        "static": [row for path in static for row in read_table(path, COLUMNS)],
        "samples": [row for path in tables for row in read_table(path, COLUMNS)],
    }
    summary = {source: summarise_errors(rows, source) for source, rows in parts.items()}
    write_table(table, [row for rows in summary.values() for row in rows])
    write_page(
        page,
        "Registration: errors of the round trip to offsets and back",
        "<p>Every garment is laid onto the body, stored as offsets of body vertices, and rebuilt"
        f" from them. The goals are mean surface errors below {TARGET_MM:g} mm in both directions,"
        " and neither holes nor islands in the cleaned mask. Area counts as lost where the garment"
        " is more than 10 mm from the rebuilt one.</p>",
        "<h2>Static outfits</h2>",
        html_table(_wide(summary["static"])),
        "<h2>Simulated samples, in their rest pose</h2>",
        html_table(_wide(summary["samples"])),
    )


def _wide(rows: Sequence[dict[str, str]]) -> list[dict[str, Cell]]:
    """One row per type, one column per metric."""
    wide: dict[str, dict[str, Cell]] = {}
    for row in rows:
        metric = row["metric"]
        shown = "total" if metric in _SUMMED else "max" if metric in _LARGEST else "mean"
        classes = ["number"]
        if metric in _BOUNDED:
            classes.append("good" if float(row[shown]) <= _BOUNDED[metric] else "bad")
        line = wide.setdefault(
            row["garment"],
            {"garment": Cell(row["garment"]), "garments": Cell(row["garments"], "number")},
        )
        text = f"{float(row[shown]):.2f}" if "." in row[shown] else row[shown]
        line[metric.replace("_", " ")] = Cell(text, *classes)
    return list(wide.values())
