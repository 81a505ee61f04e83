"""How well SMPLicit's garments follow poses, beside skinning alone and displacements of no pose."""

from collections.abc import Iterable
from pathlib import Path

from drapeline.metrics.table import read_metrics
from drapeline.report.html import html_table, write_page
from drapeline.report.models.smplicit.tables import MODELS, metric_table

_VARIANTS = {
    "nearest": "Skinning by the nearest vertex (the paper's)",
    "smoothed": "Smoothed skinning",
    "mean": "With the mean displacement",
    "ridge": "With ridge regression on the pose",
    "network": "With the network",
    "other_pose": "With the network, pose of another frame",
    "at_rest": "With the network, pose of rest",
    "untrained": "With the untrained network",
}
_METRICS = {
    "vertex_error_mm": ("Vertices (mm)", 1),
    "predicted_to_true_mm": ("To the simulated cloth (mm)", 1),
    "true_to_predicted_mm": ("From the simulated cloth (mm)", 1),
    "area_ratio": ("Area, of the simulated (%)", 0),
    "inside_share": ("Inside the body (%)", 1),
    "inside_1cm_share": ("Deeper than 1 cm (%)", 1),
}


def write_displacement_page(path: str | Path, tables: Iterable[str | Path]) -> None:
    """Write the page of the table.

    Args:
        path: the HTML page.
        tables: of metrics, of any models.

    Raises:
        InputError: a table is missing or unusable.
    """
    rows = [row for table in tables for row in read_metrics(table) if row.model == "smplicit"]
    models = {f"displacement_{name}": title for name, title in MODELS.items()}
    write_page(
        path,
        "SMPLicit: garments in motion",
        "<p>Simulated samples of the test split, which no training has seen, in frames spread over"
        " their motion. The true garment at rest is displaced in the T-pose, as the pose asks for,"
        " and skinned; then it is compared with the simulated frame. Means over frames with 95 %"
        " intervals from resampling samples, where there are three or more.</p>",
        html_table(metric_table(rows, _METRICS, models, _VARIANTS)),
        "<p>Displacements are added to smoothed skinning, for garments that have no code of their"
        " own. The mean displacement is the fair opponent: it says how cloth hangs in motion"
        " whatever the pose is. If the network gains by the pose, it is worse with that of a frame"
        " half a sequence away, or of rest. Nothing is pushed out of the body here.</p>",
    )
