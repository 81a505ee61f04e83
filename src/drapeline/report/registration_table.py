"""Errors of garment -> offsets -> garment, summarised by garment type."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.error_table import COLUMNS, FILE_NAME
from drapeline.report.html import Cell, number
from drapeline.report.tables import Section, write_sections
from drapeline.schema import Column, Schema, Table, make_table, read_table, write_table

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
_STATISTICS = ("mean", "median", "max", "total")
ERRORS = Schema(
    "a table of registration errors",
    {name: Column(float, text=".6g") if name == "value" else Column() for name in COLUMNS}
    | {"garment": Column(allowed=GARMENTS)},
)
SUMMARY = Schema(
    "a summary of registration errors",
    {
        "source": Column(),
        "garment": Column(allowed=GARMENTS),
        "metric": Column(),
        "garments": Column(int, low=1),
        **{name: Column(float, text=".6g" if name == "total" else ".4g") for name in _STATISTICS},
        "unit": Column(),
    },
    key=("source", "garment", "metric"),
)


def summarise_errors(errors: Table, source: str) -> Table:
    """Summarise a group's errors to a row per type and metric: mean, median, maximum and sum."""
    found = errors.assign(garment=pd.Categorical(errors["garment"], GARMENTS), source=source)
    metrics = list(dict.fromkeys(errors["metric"]))
    found["metric"] = pd.Categorical(found["metric"], metrics)
    by = found.groupby(["source", "garment", "metric", "unit"], observed=True, as_index=False)
    summary = by["value"].agg(["count", "mean", "median", "max", "sum"])
    summary = summary.rename(columns={"count": "garments", "sum": "total"})
    return make_table(SUMMARY, summary.to_dict("records"))


def write_registration_tables(
    table: str | Path, page: str | Path, groups: Mapping[str, Sequence[str | Path]]
) -> None:
    """Write the summary as `.tsv` and as a page.

    Args:
        table: the `.tsv`.
        groups: group -> folders of its registered shards, with a table for each shard or for each
            sample in it; those of rejected samples have none.

    Raises:
        InputError: a table is missing or lacks a column.
    """
    summary = {
        group: summarise_errors(
            _read([path for shard in shards for path in sorted(Path(shard).rglob(FILE_NAME))]),
            group,
        )
        for group, shards in groups.items()
    }
    write_table(table, pd.concat(summary.values(), ignore_index=True), SUMMARY)
    about = (
        "Every garment is laid onto the body, stored as offsets of body vertices, and rebuilt"
        f" from them. The goals are mean surface errors below {TARGET_MM:g} mm in both directions,"
        " and neither holes nor islands in the cleaned mask. Area counts as lost where the garment"
        " is more than 10 mm from the rebuilt one."
    )
    title = "Registration: errors of the round trip to offsets and back"
    sections = (
        Section(f"Group {group}, in the rest pose", errors_by_type(rows, _cell))
        for group, rows in summary.items()
    )
    write_sections(page, title, [about], sections)


def errors_by_type(
    summary: Table, cell: Callable[[pd.Series], tuple[str, Cell]]
) -> list[dict[str, object]]:
    """One row per type of a summary, one column per metric, whose heading and cell `cell` gives."""
    return [
        {
            "Garment": garment,
            "Garments": number(part["garments"].iloc[0]),
            **dict(cell(row) for _, row in part.iterrows()),
        }
        for garment, part in summary.groupby("garment", sort=False)
    ]


def _read(paths: Sequence[str | Path]) -> Table:
    return pd.concat([make_table(ERRORS, []), *(read_table(path, ERRORS) for path in paths)])


def _cell(row: pd.Series) -> tuple[str, Cell]:
    metric = row["metric"]
    shown = row["total" if metric in _SUMMED else "max" if metric in _LARGEST else "mean"]
    verdict = [] if metric not in _BOUNDED else ["good" if shown <= _BOUNDED[metric] else "bad"]
    text = f"{shown:.0f}" if metric in _SUMMED else f"{shown:.2f}"
    return metric.replace("_", " ").capitalize(), number(text, *verdict)
