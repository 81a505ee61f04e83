"""Pages of SMPLicit: how well it holds garments, and what its codes say about them."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.job import Job
from drapeline.metrics.registry import variants
from drapeline.metrics.smplicit import MODEL
from drapeline.report.html import Cell, number
from drapeline.report.tables import MetricTable, Section, read_test_metrics, write_sections
from drapeline.storage import read_rows, write_rows

_PICTURED = tuple(name for name in variants(MODEL) if name.startswith(f"{MODEL}_images_"))
_HELD = tuple(name for name in variants(MODEL) if name not in _PICTURED)
# Of pictures, whose garments are few and away by centimetres.
_SURFACES = ("surface_to_true_mm", "true_to_surface_mm", "rest_to_true_mm", "true_to_rest_mm")
_WHOLE = dict.fromkeys(("segmentation_accuracy", *_SURFACES), 0)
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
                *_SURFACES,
            ),
            digits=_WHOLE,
        ),
        below="Simulated samples of the test split, of the dataset and of those that models"
        " learn from (the fast solver's), in motion. Body and camera are known, and the fit sees"
        " the segmentation alone. The mean code here is that of the garment's class, such"
        " as all dresses. The training code of the class with the least loss is the fair"
        " opponent: it needs no fit. Garments are skinned with smoothed weights, or"
        " the fast cloth solver lets them hang on the person; both are compared"
        " with the mean code worn in the same way. Where two people are in a picture, the one"
        " in front hides a part of the other. Intervals are from resampling clips.",
        by_source=True,
    ),
)
Row = Mapping[str, str]


def write_smplicit_page(path: str | Path, metrics: str | Path) -> None:
    """Write the page of tables.

    Args:
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
            " of each model is green."
        ],
        _SECTIONS,
        read_test_metrics(metrics, [MODEL]),
    )


class GalleryTables(NamedTuple):
    """Rows of the tables of a model's gallery, as they are written."""

    garments: Sequence[Row]  # of `garments.tsv`
    correlations: Sequence[Row]  # of `correlations.tsv`
    regressions: Sequence[Row]  # of `regressions.tsv`


def read_gallery_tables(folder: str | Path) -> GalleryTables:
    """Read the tables of a gallery.

    Raises:
        InputError: a table is missing.
    """
    paths = (Path(folder) / f"{name}.tsv" for name in GalleryTables._fields)
    return GalleryTables(*(read_rows(path, "a table of a gallery")[1] for path in paths))


def write_correlations(path: str | Path, galleries: Mapping[str, GalleryTables]) -> None:
    """Write the correlations of all models to a single table."""
    rows = [row for tables in galleries.values() for row in tables.correlations]
    write_rows(path, rows)


def write_gallery_page(path: str | Path, galleries: Mapping[str, GalleryTables]) -> None:
    """Write the page of the tables of each model's gallery."""
    write_sections(
        path,
        "SMPLicit: what codes say about garments",
        [
            "Properties are measured on the meshes of training garments, as shares of their"
            " wearers' limbs."
        ],
        [
            Section(title, [row for part in galleries.items() for row in rows(*part)], below=below)
            for title, rows, below in _GALLERY
        ],
    )


def _axes(model: str, tables: GalleryTables) -> list[dict[str, object]]:
    rows: dict[str, dict[str, object]] = {}
    for row in tables.correlations:
        start: dict[str, object] = {
            "Model": model,
            "Axis": number(row["axis"]),
            "Deviation": number(f"{float(row['deviation']):.3f}"),
        }
        entry = rows.setdefault(row["axis"], start)
        entry[row["title"].capitalize()] = _number(row["correlation"], 2)
    return list(rows.values())


def _told(model: str, tables: GalleryTables) -> list[dict[str, object]]:
    return [
        {
            "Model": model,
            "Property": row["title"],
            "What is measured": row["about"],
            "Unit": row["unit"],
            "Mean": _number(row["mean"], 1),
            "Deviation": _number(row["deviation"], 1),
            "Garments": number(row["garments"]),
            "Explained share": _number(row["explained_share"], 2),
        }
        for row in tables.regressions
    ]


def _edits(model: str, tables: GalleryTables) -> list[dict[str, str]]:
    told = {row["property"]: row for row in tables.regressions}
    edited = [row for row in tables.garments if row["sheet"] == "edits"]
    out = []
    for name in dict.fromkeys(row["about"] for row in edited):
        rows = [row for row in edited if row["about"] == name]
        off = [abs(_value(row[name]) - _value(row["asked"])) for row in rows]
        moved = [
            float(np.std([_value(row[other]) for row in rows])) / _value(told[other]["deviation"])
            for other in told
            if other != name
        ]
        out.append(
            {
                "Model": model,
                "Property": told[name]["title"],
                "Mean error": _mean(off, 1),
                "Unit": told[name]["unit"],
                "In deviations": _mean(np.divide(off, _value(told[name]["deviation"])), 2),
                "Others vary by (deviations)": _mean(moved, 2),
            }
        )
    return out


def _samples(model: str, tables: GalleryTables) -> list[dict[str, object]]:
    samples = [row for row in tables.garments if row["sheet"] == "samples"]
    return [
        {
            "Model": model,
            "Drawn from": title,
            "Number": number(len(rows)),
            "Like training garments": number(sum(row["like_training"] == "true" for row in rows)),
            "Nothing left": number(sum(row["vertices"] == "0" for row in rows)),
            "Inside the body (%)": _mean([100 * _value(row["inside_share"]) for row in rows], 2),
        }
        for title in dict.fromkeys(row["row"] for row in samples)
        if (rows := [row for row in samples if row["row"] == title])
    ]


# Title of a section, what makes its rows, and the paragraph below.
_GALLERY = (
    (
        "Principal axes of z_cut and their correlations with properties",
        _axes,
        "Pearson's correlation over training garments. An axis points to where the property that it"
        " correlates with most increases.",
    ),
    (
        "What a whole code tells of a property",
        _told,
        "The explained share is that of linear regressions, each of which predicts a garment that"
        " it was not fitted to; below zero it is worse than the mean. Properties of which less than"
        " half is explained cannot be edited.",
    ),
    (
        "Edits: what was asked for, and what was measured on the mesh",
        _edits,
        "Five garments for each property, from the 5th to the 95th percentile of training garments,"
        " all from the mean code of one type. Deviations are those of training garments; the last"
        " column is the mean standard deviation of the other properties over the five, which an"
        " edit should keep.",
    ),
    (
        "Samples",
        _samples,
        "A sample is like the training garments if it has as many openings as most of its type"
        " have, and all its properties lie between theirs, or up to a tenth of the span beyond. Its"
        " type is that of the training garment with the nearest code. Ragged edges and torn"
        " necklines go unnoticed.",
    ),
)


def _value(text: str) -> float:
    return float(text) if text else np.nan


def _number(text: str, digits: int) -> Cell:
    return number(f"{float(text):.{digits}f}" if text else "-")


def _mean(values: Iterable[float], digits: int) -> Cell:
    known = [value for value in values if np.isfinite(value)]
    return number(f"{np.mean(known):.{digits}f}" if known else "-")


def tabulate(job: Job) -> None:
    """How well SMPLicit holds held-out garments."""
    write_smplicit_page(job.output[0], job.input.metrics)


def tabulate_gallery(job: Job) -> None:
    """What codes say about garments."""
    galleries = dict(
        zip(job.params.models, map(read_gallery_tables, job.input.galleries), strict=True)
    )
    write_gallery_page(job.output.page, galleries)
    write_correlations(job.output.table, galleries)
