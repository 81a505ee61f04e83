"""Tables of how well SMPLicit holds held-out garments, beside trivial answers."""

from functools import partial
from pathlib import Path

from drapeline.metrics.registry import variants
from drapeline.metrics.smplicit import MODEL
from drapeline.report.tables import MetricTable, Section, read_test_metrics, write_sections

_PICTURED = tuple(name for name in variants(MODEL) if name.startswith(f"{MODEL}_images_"))
_HELD = tuple(name for name in variants(MODEL) if name not in _PICTURED)
# Of pictures, whose garments are few and away by centimetres.
_WHOLE = dict.fromkeys(("segmentation_accuracy", "surface_to_true_mm", "true_to_surface_mm"), 0)
_held = partial(MetricTable, _HELD)
_SECTIONS = (
    Section(
        "The open surface",
        _held(
            (
                *("surface_to_true_mm", "true_to_surface_mm", "normal_error_deg"),
                *("openings_right", "pieces", "inside_share", "inside_1cm_share"),
            )
        ),
        below="The nearest training garment is the true one, carried to the wearer's body: it needs"
        " no network to be drawn, and its openings are right wherever it is of the same type.",
    ),
    Section(
        "The walls on both sides of the cloth, as in the paper",
        _held(("walls_to_true_mm", "true_to_walls_mm")),
    ),
    Section(
        "The field at points that no code was fitted to",
        _held(("field_near_mm", "field_space_mm")),
        below="Distances are clipped; the errors are those of clipped distances.",
    ),
    Section(
        "Garments found in pictures",
        MetricTable(
            _PICTURED,
            (
                *("silhouette_iou", "better_than_mean_share", "segmentation_accuracy"),
                *("surface_to_true_mm", "true_to_surface_mm"),
            ),
            digits=_WHOLE,
        ),
        below="Simulated samples of the test split, of the dataset and of the learning group, in"
        " motion. Body and camera are known, and the fit sees the segmentation alone. The mean code"
        " here is that of the garment's class, such as all dresses. The training code of the class"
        " with the least loss is the fair opponent: it needs no fit. Garments are skinned"
        " with smoothed weights, or the fast cloth solver lets them hang on the person; both are"
        " compared with the mean code worn in the same way. Where two people are in a picture, the"
        " one in front hides a part of the other. Intervals are from resampling samples.",
        by_source=True,
    ),
)


def write_smplicit_page(path: str | Path, metrics: str | Path) -> None:
    """Write the page of tables.

    Args:
        path: the HTML page.
        metrics: table of metrics; models that it does not hold have no row.

    Raises:
        InputError: the table is missing or unusable.
    """
    write_sections(
        path,
        "SMPLicit: distance fields of garments",
        [
            "Test split of static outfits, which no training has seen. Means over garments with"
            " 95 % intervals from resampling outfits; distances are means over the area of the"
            " surface. Codes start at what the image encoder makes of the occlusion image and a"
            " style of zero, and are fitted to samples of the garment's distance field. The best"
            " of each model is green.",
        ],
        _SECTIONS,
        read_test_metrics(metrics, [MODEL]),
    )
