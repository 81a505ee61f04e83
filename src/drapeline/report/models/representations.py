"""The comparison of all models: the same garments through their codes."""

from collections.abc import Sequence
from pathlib import Path

from drapeline.metrics.table import ALL, HIGH, LOW, MetricRow, find_value, read_metrics
from drapeline.report.html import html_table, write_page
from drapeline.report.models.garment_columns import garment_columns

# Shown under these names and in this order; other representations go by their variant.
_CODES = {
    "svae": "SVAE",
    "static_ppca": "Masked PPCA",
    "body_pca": "PCA of offsets from the body",
    "garment4d_pca": "PCA of Garment4D's templates",
    "smplicit": "SMPLicit's cut and style",
}
_WITHOUT_CODE = {
    "body_registered": "registered to the body",
    "template_registered": "registered to the template",
}
_WAYS = {
    "surface_to_true_mm": "From the reconstruction to the original garment",
    "true_to_surface_mm": "From the original garment to the reconstruction",
}


def write_representations(path: str | Path, metrics: str | Path, split: str) -> None:
    """Write the page.

    Args:
        path: the HTML page.
        metrics: table of metrics with the rows of `compare_representations`.
        split: the one shown.

    Raises:
        InputError: the table is missing or unusable.
    """
    rows = read_metrics(metrics)
    parts = [
        "<p>All garments of these types in the test split of static outfits, which no model has"
        " seen. Mean distances over the area of the surfaces in mm, with 95 % intervals over"
        " outfits. No code can recover what registration loses, which the rows without a code"
        " show. The size of a code does not count the body's shape and other inputs of its decoder;"
        " where it differs between types, it is listed by type.</p>"
    ]
    for metric, title in _WAYS.items():
        parts += [f"<h2>{title} (mm)</h2>", html_table(_table(rows, metric, split))]
    write_page(path, "The same garments through all codes", *parts)


def _table(rows: Sequence[MetricRow], metric: str, split: str) -> list[dict[str, object]]:
    found = []
    for variant, name in _names(rows).items():
        cells: dict[str, object] = {
            "Code": name,
            "Size of the code": _size(rows, variant, split),
        }
        for garment in (*garment_columns(rows), ALL):
            cells[garment] = _cell(rows, variant, split, garment, metric)
        found.append(cells)
    return found


def _names(rows: Sequence[MetricRow]) -> dict[str, str]:
    """Variant -> what it is called: codes first, then representations without a code."""
    coded = {row.variant for row in rows if row.metric == "code_numbers"}
    others = dict.fromkeys(row.variant for row in rows if row.variant not in _CODES)
    codes = _CODES | {variant: variant for variant in others if variant in coded}
    without = _WITHOUT_CODE | {v: v for v in others if v not in _WITHOUT_CODE and v not in coded}
    return codes | {variant: f"no code: {name}" for variant, name in without.items()}


def _size(rows: Sequence[MetricRow], variant: str, split: str) -> str:
    """Size of the code, by type where it differs."""
    found = [find_value(rows, variant, split, g, "code_numbers") for g in garment_columns(rows)]
    sizes = [f"{row.value:.0f}" if row else "-" for row in found]
    return sizes[0] if len(set(sizes)) == 1 else " / ".join(sizes)


def _cell(rows: Sequence[MetricRow], variant: str, split: str, garment: str, metric: str) -> str:
    value, low, high = (
        find_value(rows, variant, split, garment, metric + end) for end in ("", LOW, HIGH)
    )
    if value is None:
        return "-"
    if low is None or high is None:
        return f"{value.value:.2f}"
    return f"{value.value:.2f} ({low.value:.2f} to {high.value:.2f})"
