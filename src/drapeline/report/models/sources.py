"""Tables of the samples of each cloth solver, beside those of all."""

from collections.abc import Callable, Mapping, Sequence

from drapeline.metrics.table import MetricRow
from drapeline.report.html import html_table


def tables_by_source(
    rows: Sequence[MetricRow],
    table: Callable[[Sequence[MetricRow]], Sequence[Mapping[str, object]]],
) -> list[str]:
    """HTML of a table for each source, with a heading; nothing where there is only one.

    Args:
        rows: of all sources.
        table: makes the table of the rows of one, which name no source then.
    """
    parts = []
    for source in sorted({row.source for row in rows} - {""}):
        own = [row._replace(source="") for row in rows if row.source == source]
        parts += [f"<h3>On the samples of {source} alone</h3>", html_table(table(own))]
    return parts
