"""Tables of metrics with made-up values."""

from drapeline.metrics.table import METRICS, unit_of
from drapeline.schema import make_table


def metric_row(variant, garment, metric, value, *, model="garment4d", split="test", n=5, source=""):
    """A row of a model; its unit is the metric's."""
    values = (model, variant, split, garment, metric, value, unit_of(metric), n, 0, source)
    return dict(zip(METRICS.columns, values, strict=True))


def metric_table(rows):
    """The table of some rows."""
    return make_table(METRICS, rows)


def find_value(table, variant, split, garment, metric, source=""):
    """The first row of that name and source, of any model and seed, or None."""
    found = table.query(
        "variant == @variant and split == @split and garment == @garment and metric == @metric"
        " and source == @source"
    )
    return found.iloc[0] if len(found) else None
