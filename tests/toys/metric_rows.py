"""Rows of the table of metrics with made-up values."""

from drapeline.metrics.table import HIGH, LOW, UNITS, MetricRow


def metric_row(variant, garment, metric, value, *, model="garment4d", split="test", n=5, source=""):
    """A row of a model; its unit is the metric's."""
    unit = UNITS[metric.removesuffix(LOW).removesuffix(HIGH)]
    return MetricRow(model, variant, split, garment, metric, value, unit, n, 0, source)
