"""Which garment types tables and curves of metrics have a column or a line for."""

from collections.abc import Iterable

from drapeline.metrics.table import MetricRow
from drapeline.outfits.garment_types import TEMPLATE_TYPES


def garment_columns(rows: Iterable[MetricRow]) -> list[str]:
    """The types that all models may learn and that rows are about, in the papers' order."""
    found = {row.garment for row in rows}
    return [garment for garment in TEMPLATE_TYPES if garment in found]
