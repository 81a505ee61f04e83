"""Tables 2 to 5 of the Garment4D paper for our models, with baselines, ablations and contact."""

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from drapeline.job import Job
from drapeline.metrics.garment4d import COMPARED, DEGRADED, MODEL
from drapeline.outfits.garment_types import TABLE_TYPES
from drapeline.registration.error_table import FILE_NAME
from drapeline.report.html import Cell, number
from drapeline.report.registration_table import ERRORS, errors_by_type, summarise_errors
from drapeline.report.tables import (
    MetricTable,
    Section,
    printed,
    read_test_metrics,
    write_beside_paper,
    write_sections,
)
from drapeline.schema import Table, read_table

PAPER = "Garment4D"
REGISTRATION_TARGET_MM = 5.0

_CANONICAL = (
    *("mean_garment", "pointnet", "canonical_untrained", "canonical", "regression", "ours"),
    *("ours_true_labels", "pca", "truth"),
)
_LABELS = ("one_label", "label_by_vertex", "canonical", "ours")
_POSED = ("lbs", "untrained", "mgn", "posed", "ours_proposals", "ours")
_FLOOR = ("again_rest_shape", "again_other_solver")
_ORACLES = ("ours_true_labels", "ours_true_rest", *_FLOOR)
_MOVING = ("still", *_POSED)
_CONTACT = ("truth", *_POSED)
_ABLATIONS = (
    *("posed", "no_body_encoder", "no_transformer", "released_loss", "pulled"),
    *("nearest_weights", "vertex_sampled", "mgn", "mgn_pulled"),
)
_WORSE = [f"{model}_{worse}" for worse in DEGRADED for model in COMPARED]
# Setting of the experiment -> how a model with it departs from the paper's.
DEPARTURES = {
    "frames": "Windows of the paper's networks have another number of frames than its ten.",
    "width": "Layers of the canonical networks have other widths than the released code's.",
    "balance": (
        "In the loss of the labels, points weigh more the rarer their label is among the training"
        " points; in the paper all weigh the same."
    ),
    "interpenetration": (
        "Cloth inside the body weighs less in the loss of the posed stage than in the released"
        " code: few steps would teach it little but to push cloth out."
    ),
    "pull_neighbours": (
        "In each iteration, vertices are also drawn towards the nearest garment points by a learned"
        " share; the paper's network is not told where these points are."
    ),
    "smooth_passes": (
        "In the end, the displacements of a whole sequence are averaged over neighbouring frames,"
        " which the paper does not do. Those of MGN* are not averaged."
    ),
}
# Hong, Pan, Cai and Liu, Garment4D: Garment Reconstruction from Point Cloud Sequences, NeurIPS
# 2021: per type in this order. Table 5 is of licensed scans.
_PRINTED_TYPES = ("Skirt", "Tshirt", "Trousers")
_PRINTED = {
    number: printed(
        MODEL,
        {
            (name, garment): {metric: value}
            for name, values in rows.items()
            for garment, value in zip(_PRINTED_TYPES, values, strict=True)
        },
    )
    for number, metric, rows in (
        (
            "2",
            "canonical_error_mm",
            {"pointnet": (33.71, 41.05, 20.80), "canonical": (30.23, 28.39, 18.16)},
        ),
        (
            "3",
            "vertex_error_mm",
            {
                "lbs": (79.52, 44.55, 31.05),
                "mgn": (71.66, 40.54, 29.12),
                "posed": (49.39, 37.83, 26.48),
            },
        ),
        (
            "4",
            "acceleration_error_m_s2",
            {"mgn": (12.59, 7.173, 4.135), "posed": (3.273, 4.749, 2.520)},
        ),
    )
}
# Figure 6: what leaving a part out adds to the errors.
_PRINTED_ABLATIONS = (
    ("Without body surface encoder", "+8.42", "-"),
    ("Without temporal transformer", "+2.21", "+5.575"),
    ("With weights of the nearest body vertex", "+7.1", "-"),
)
_by_type = partial(
    MetricTable, garments=TABLE_TYPES, across="garment", count="Sequences", paper=PAPER
)
_SECTIONS = (
    Section(
        "Table 2: canonical garments, vertex error M1 (mm)",
        _by_type(_CANONICAL, ["canonical_error_mm"], printed=_PRINTED["2"]),
        "Both the losses and M1 measure against the registered garment, not the original.",
    ),
    Section(
        "Distance to the garment as simulated (mm)",
        _by_type(_CANONICAL, ["canonical_to_original_mm"]),
        "M1 does not see what registration loses. These are distances between surfaces, over"
        " their area, to the garment before registration; the last row is what registration"
        " alone loses.",
    ),
    Section("Points with the right label (%)", _by_type(_LABELS, ["segmentation_accuracy"])),
    Section(
        "Table 3: posed garments, vertex error M2 (mm)",
        _by_type((*_POSED, *_ORACLES), ["vertex_error_mm"], printed=_PRINTED["3"]),
    ),
    Section(
        "M2 along the normals of the true surface (mm)",
        _by_type((*_POSED, *_ORACLES), ["off_surface_mm"]),
        "What is left of M2 is beside the right place, but on the surface or parallel to it.",
    ),
    Section("M2 along the true surface (mm)", _by_type((*_POSED, *_ORACLES), ["along_surface_mm"])),
    Section(
        "From the reconstructed surface to the true one (mm)",
        _by_type((*_POSED, *_ORACLES), ["predicted_to_true_mm"]),
        "M2 also counts vertices that lie on the true surface but beside their place. This is the"
        " mean distance of the reconstruction's vertices from the true surface, in every fifth"
        " frame; the next table is the other way.",
    ),
    Section(
        "From the true surface to the reconstructed one (mm)",
        _by_type((*_POSED, *_ORACLES), ["true_to_predicted_mm"]),
    ),
    Section(
        "Velocity error (m/s)",
        _by_type((*_MOVING, *_ORACLES), ["velocity_error_m_s"]),
        "A garment that never moves is as good in M3 as one that moves a little late. It is not in"
        " velocities, which noise hardly changes.",
    ),
    Section(
        "Table 4: acceleration error M3 (m/s²)",
        _by_type((*_MOVING, *_FLOOR), ["acceleration_error_m_s2"], printed=_PRINTED["4"]),
    ),
    Section(
        "Motion, as a share of the true one's",
        MetricTable(
            (*_POSED, *_ORACLES),
            ("slow_motion", "quick_motion", "fast_motion"),
            TABLE_TYPES,
            down=("garment", "variant"),
            best=False,
            count="Sequences",
        ),
        "Root mean square of velocities in bands of frequency, relative to the root joint: 1 is as"
        " much as the true garment moves. Less in the upper bands is cloth that folds too little,"
        " more is cloth that shakes.",
    ),
    Section(
        "By cloth solver",
        MetricTable(
            ("mean_garment", "pointnet", "canonical", "regression", *_MOVING, *_FLOOR),
            (
                *("canonical_error_mm", "vertex_error_mm", "predicted_to_true_mm"),
                "acceleration_error_m_s2",
            ),
            TABLE_TYPES,
            across="source",
            best=False,
            count="Sequences",
            down=("metric", "garment", "variant"),
        ),
        "The same measures on the samples of each solver. The networks saw samples of all of them"
        " in training.",
    ),
    Section(
        "Table 5: distance of vertices to the cloud, one way (mm)",
        _by_type(_CONTACT, ["to_cloud_mm"]),
        "To the whole cloud, skin included. On clouds with holes this distance rises wherever"
        " points are missing, even for a perfect garment; the first row, the ground truth,"
        " shows by how much.",
    ),
    Section(
        "Vertices inside the body",
        MetricTable(
            _CONTACT,
            ("inside_share", "inside_1cm_share", "inside_depth_mm"),
            TABLE_TYPES,
            down=("garment", "variant"),
            count="Sequences",
        ),
    ),
    Section(
        "Ablations (figure 6) and inputs: M2 (mm)",
        _by_type(_ABLATIONS, ["vertex_error_mm"]),
        "The first row is the full model. That with weights of the nearest body vertex was trained"
        " on such proposals, which are not smoothed either. The row with mesh vertices is the full"
        " model, which learned from points on surfaces, given points as the released code samples"
        " them.",
    ),
    Section("Ablations and inputs: M3 (m/s²)", _by_type(_ABLATIONS, ["acceleration_error_m_s2"])),
    Section(
        f"Figure 6 as {PAPER} prints it: error added by leaving a part out",
        [
            {
                f"{PAPER} (other data)": title,
                "Vertex error (mm)": number(vertex, "theirs"),
                "Acceleration error (m/s²)": number(acceleration, "theirs"),
            }
            for title, vertex, acceleration in _PRINTED_ABLATIONS
        ],
    ),
    Section(
        "Neighbours K (figure 8): M2 (mm)",
        _by_type(["neighbours_*"], ["vertex_error_mm"], best=False),
        "By the full model, trained once: only its proposals change, and their weights are smoothed"
        " for every K, even K = 1.",
    ),
    Section(
        "Holes, wrong labels (figures 9 and 10), other worse inputs: M2 (mm)",
        _by_type(_WORSE, ["vertex_error_mm"], best=False),
        "On some of the sequences, which the first rows show as they are. Poses are off by the same"
        " in all frames, and shapes are off as well.",
    ),
    Section(
        "The same of our garments at rest: M1 (mm)",
        _by_type([f"ours_{worse}" for worse in DEGRADED], ["canonical_error_mm"], best=False),
    ),
    Section(
        "Time per frame (ms)",
        _by_type(_POSED, ["inference_s_per_frame"]),
        "For everything from the points to the garment.",
    ),
)
_ABOUT = (
    "Test split, which only evaluation reads. Means over whole sequences, all of one weight,"
    " with 95 % intervals from resampling clips where there are three or more. The smallest"
    " error of a column, or the largest share of right labels, is green. All models are given"
    " the pose and shape of the body, as in the released code;"
    " <code>snakemake garment4d_ablations</code> adds tables of what worse inputs do.",
    "Rows named ours are of a model of our own, which has no part in the others: a network labels"
    " points, whatever the type, by their place on the body too; a regression on maps of the body"
    " guesses the garment at rest; the guess is corrected by how far it must stretch to lie on the"
    " points; it is skinned or simulated, and laid on the points.",
    f"Shaded columns are {PAPER}'s, as printed. The paper's garments, bodies, registration and"
    " number of sequences are different, its clouds are mesh vertices, and its best checkpoint was"
    " chosen on the sequences that it reports: none of this can be compared with ours. Its table 5"
    " is about licensed scans and is not repeated.",
)


def write_garment4d_page(
    path: str | Path,
    metrics: str | Path,
    registration: Iterable[str | Path] = (),
    departures: Iterable[str] = (),
) -> None:
    """Write the page of tables.

    Args:
        metrics: table of metrics; models that it does not hold have no row.
        registration: tables of errors of garments registered to templates.
        departures: keys of `DEPARTURES` that hold for the models.

    Raises:
        InputError: a table is missing or unusable.
    """
    errors = [read_table(table, ERRORS) for table in registration]
    registered = Section(
        "Registration to the templates",
        _registration(errors),
        "Mean distances between a garment and its copy in the template's topology. The goal is"
        f" below {REGISTRATION_TARGET_MM:g} mm, with no face flipped.",
    )
    write_sections(
        path,
        "Garment4D: tables 2 to 5, for this dataset",
        [*_ABOUT, *(DEPARTURES[name] for name in departures)],
        [*_SECTIONS, registered],
        read_test_metrics(metrics, [MODEL]),
    )


def write_garment4d_beside_paper(path: str | Path, metrics: str | Path) -> None:
    """Write a tab-separated table with our errors and the paper's in two columns.

    Raises:
        InputError: the table of metrics is missing or unusable.
    """
    write_beside_paper(path, read_test_metrics(metrics, [MODEL]), _PRINTED)


def _registration(errors: Sequence[Table]) -> list[dict[str, object]]:
    """One row per type and one column per metric: means, of whole numbers sums."""
    if not errors:
        return []

    def cell(row: pd.Series) -> tuple[str, Cell]:
        title = row["metric"].replace("_", " ").removesuffix(" mm").capitalize()
        if row["unit"] == "count":
            verdict = "good" if row["total"] == 0 else "bad"
            return f"{title}, total", number(f"{row['total']:.0f}", verdict)
        verdict = "good" if row["mean"] <= REGISTRATION_TARGET_MM else "bad"
        text = f"{row['mean']:.2f}, at most {row['max']:.2f}"
        return f"{title} (mm)", number(text, verdict)

    return errors_by_type(summarise_errors(pd.concat(errors), "template"), cell)


def tabulate(job: Job) -> None:
    """Tables 2 to 4, and our numbers beside the paper's."""
    given = job.input
    errors = [Path(fits) / FILE_NAME for fits in given.fits]
    write_garment4d_page(job.output.page, given.metrics, errors, job.params.departures)
    write_garment4d_beside_paper(job.output.table, given.metrics)
