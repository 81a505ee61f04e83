"""How well SMPLicit's garments follow poses, beside skinning alone and displacements of no pose."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from drapeline.metrics.registry import variants
from drapeline.metrics.smplicit import MODEL
from drapeline.report.tables import MetricTable, Section, read_test_metrics, write_sections

_MOVED = tuple(name for name in variants(MODEL) if name.startswith(f"{MODEL}_displacement_"))
_SECTION = Section(
    "Distances to the simulated cloth",
    MetricTable(
        _MOVED,
        (
            *("vertex_error_mm", "predicted_to_true_mm", "true_to_predicted_mm"),
            *("area_ratio", "inside_share", "inside_1cm_share"),
        ),
        count="Frames",
    ),
    below="Displacements are added to smoothed skinning, for garments that have no code of their"
    " own. The mean displacement is the fair opponent: it says how cloth hangs in motion whatever"
    " the pose is. If the network gains by the pose, it is worse with that of a frame half a"
    " sequence away, or of rest. Nothing is pushed out of the body here.",
)


def write_displacement_page(path: str | Path, tables: Iterable[str | Path]) -> None:
    """Write the page of the table.

    Args:
        path: the HTML page.
        tables: of metrics, of any models.

    Raises:
        InputError: a table is missing or unusable.
    """
    write_sections(
        path,
        "SMPLicit: garments in motion",
        [
            "Simulated samples of the test split, which no training has seen, in frames spread over"
            " their motion. The true garment at rest is displaced in the T-pose, as the pose asks"
            " for, and skinned; then it is compared with the simulated frame. Means over frames"
            " with 95 % intervals from resampling samples, where there are three or more.",
        ],
        [_SECTION],
        pd.concat([read_test_metrics(table, [MODEL]) for table in tables]),
    )
