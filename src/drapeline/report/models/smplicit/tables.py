"""How well SMPLicit holds held-out garments, beside trivial answers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from drapeline.metrics.table import ALL, HIGH, LOW, MetricRow, read_metrics
from drapeline.report.html import Cell, html_table, write_page
from drapeline.report.models.sources import tables_by_source

MODELS = {
    "upper": "Upper body: t-shirts and tops",
    "trousers": "Trousers",
    "skirt": "Skirts",
    "whole": "Whole body: dresses and jumpsuits (not in the paper)",
}
_PICTURED = {"images": "All models"}
_VARIANTS = {
    "hung": "Hung by the cloth solver: of three outfits the one most like the picture",
    "nearest_hung": "Training code with the least loss, hung by the cloth solver",
    "mean_code_hung": "Mean code, hung by the cloth solver",
    "fitted": "Fitted code",
    "fitted_in_pair": "Fitted code; two people in a picture, one behind the other",
    "mean_code": "Mean code",
    "nearest": "Training code with the least loss",
    "nearest_cut": "Nearest training garment in z_cut",
    "nearest_style": "Nearest training garment in z_style",
    "untrained": "Untrained network, fitted code",
    "constant": "Median distance",
}
_SURFACE = {
    "surface_to_true_mm": ("To the garment (mm)", 1),
    "true_to_surface_mm": ("From the garment (mm)", 1),
    "normal_error_deg": ("Normals (deg)", 1),
    "openings_right": ("Right openings (%)", 0),
    "pieces": ("Pieces", 2),
    "inside_share": ("Inside the body (%)", 2),
    "inside_1cm_share": ("Deeper than 1 cm (%)", 2),
}
_WALLS = {
    "walls_to_true_mm": ("To the garment (mm)", 1),
    "true_to_walls_mm": ("From the garment (mm)", 1),
}
_FIELD = {
    "field_near_mm": ("Near the surface (mm)", 2),
    "field_space_mm": ("In the whole box (mm)", 2),
}
_PICTURES = {
    "silhouette_iou": ("Silhouette IoU (%)", 0),
    "better_than_mean_share": ("Better than the mean code (%)", 0),
    "segmentation_accuracy": ("Right labels (%)", 0),
    "surface_to_true_mm": ("To the garment (mm)", 0),
    "true_to_surface_mm": ("From the garment (mm)", 0),
}


def write_smplicit_page(path: str | Path, metrics: str | Path) -> None:
    """Write the page of tables.

    Args:
        path: the HTML page.
        metrics: table of metrics; models that it does not hold have no row.

    Raises:
        InputError: the table is missing or unusable.
    """
    rows = [row for row in read_metrics(metrics) if row.model == "smplicit"]
    write_page(
        path,
        "SMPLicit: distance fields of garments",
        "<p>Test split of static outfits, which no training has seen. Means over garments with"
        " 95 % intervals from resampling outfits; distances are means over the area of the"
        " surface. Codes start at what the image encoder makes of the occlusion image and a style"
        " of zero, and are fitted to samples of the garment's distance field.</p>",
        "<h2>The open surface</h2>",
        html_table(metric_table(rows, _SURFACE)),
        "<p>The nearest training garment is the true one, carried to the wearer's body: it needs no"
        " network to be drawn, and its openings are right wherever it is of the same type.</p>",
        "<h2>The walls on both sides of the cloth, as in the paper</h2>",
        html_table(metric_table(rows, _WALLS)),
        "<h2>The field at points that no code was fitted to</h2>",
        html_table(metric_table(rows, _FIELD)),
        "<p>Distances are clipped; the errors are those of clipped distances.</p>",
        "<h2>Garments found in pictures</h2>",
        html_table(_pictures(rows)),
        *tables_by_source([row for row in rows if "_images_" in row.variant], _pictures),
        "<p>Simulated samples of the test split, of the dataset and of the learning group, in"
        " motion. Body and camera are known, and the fit sees the segmentation alone. The mean code"
        " here is that of the garment's class, such as all dresses. The training code of the class"
        " with the least loss is the fair opponent: it needs no fit. Garments are skinned"
        " with smoothed weights, or the fast cloth solver lets them hang on the person; both are"
        " compared with the mean code worn in the same way. Where two people are in a picture, the"
        " one in front hides a part of the other. Intervals are from resampling samples.</p>",
    )


def _pictures(rows: Sequence[MetricRow]) -> list[dict[str, object]]:
    return metric_table(rows, _PICTURES, _PICTURED)


def metric_table(
    rows: Sequence[MetricRow],
    metrics: Mapping[str, tuple[str, int]],
    models: Mapping[str, str] = MODELS,
    variants: Mapping[str, str] = _VARIANTS,
) -> list[dict[str, object]]:
    """A row per model and variant that has any of the metrics, for `html_table`.

    Args:
        rows: of SMPLicit.
        metrics: metric -> its title, and digits after the point.
        models: part of the variant's name after "smplicit_" -> title.
        variants: the part after that -> title.
    """
    table = []
    for model, title in models.items():
        for variant, name in variants.items():
            wanted = f"smplicit_{model}_{variant}"
            key = (wanted, ALL, "")
            own = [row for row in rows if (row.variant, row.garment, row.source) == key]
            values = {row.metric: row.value for row in own}
            if any(metric in values for metric in metrics):
                cells = {text: _cell(values, key, text, k) for key, (text, k) in metrics.items()}
                count = max(row.n for row in own)
                table.append({"Garments": title, "Held as": name, "Number": count, **cells})
    return table


def _cell(values: dict[str, float], metric: str, title: str, digits: int) -> Cell:
    if metric not in values:
        return Cell("-", "number")
    scale = 100 if title.endswith("(%)") else 1
    text = f"{scale * values[metric]:.{digits}f}"
    if metric + LOW in values:
        low, high = (scale * values[metric + end] for end in (LOW, HIGH))
        text += f" [{low:.{digits}f}, {high:.{digits}f}]"
    return Cell(text, "number")
