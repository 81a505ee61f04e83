"""Tables 2 to 5 of the Garment4D paper for our models, with baselines, ablations and contact.

The paper's numbers come from other data and another body, so they have tables and a column of
their own.
"""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from drapeline.dataset.tables import read_table
from drapeline.metrics.sequence import MODEL
from drapeline.metrics.table import HIGH, LOW, MetricRow, find_value, read_metrics
from drapeline.registration.error_table import COLUMNS
from drapeline.report.html import Cell, html_table, write_page
from drapeline.report.models.garment_columns import garment_columns
from drapeline.report.registration.registration_table import summarise_errors
from drapeline.storage import atomic_file

OURS, THEIRS = "This dataset", "Garment4D (other data)"
REGISTRATION_TARGET_MM = 5.0

_CANONICAL = {
    "mean_garment": "Mean garment of the training set",
    "regression": "Regression alone, which Garment4D's network starts from here",
    "pointnet": "PN++",
    "canonical": "Garment4D",
    "pca": "Best of the garment space: T of the true alpha",
    "truth": "Registered garment itself",
}
_LABELS = {
    "one_label": "Most common label of the training points",
    "label_by_vertex": "Most common label of those at the nearest vertex of the body",
    "canonical": "Garment4D",
}
# Rows that no model competes with.
_FLOORS = ("pca", "truth")
_POSED = {
    "lbs": "Interpolated LBS",
    "untrained": "Garment4D, untrained",
    "mgn": "MGN*",
    "posed": "Garment4D",
    "ours": "Our variant (not in the paper)",
}
_MOVING = {"still": "A garment that never moves", **_POSED}
_ABLATIONS = {
    "posed": "Full model",
    "no_body_encoder": "without body surface encoder",
    "no_transformer": "without temporal transformer",
    "as_printed": "displacements as in the paper",
    "nearest_weights": "trained with weights of the nearest body vertex",
    "vertex_sampled": "given mesh vertices as points",
}
_NOISY = {
    "pointnet_noisy_body": "PN++",
    "canonical_noisy_body": "Garment4D",
    "lbs_noisy_body": "Interpolated LBS",
    "mgn_noisy_body": "MGN*",
    "noisy_body": "Garment4D",
    "ours_noisy_body": "Our variant (not in the paper)",
}
_CONTACT = {"truth": "Ground truth itself", **_POSED}
# Metric -> digits shown.
_DIGITS = {
    "canonical_error_mm": 1,
    "canonical_to_original_mm": 1,
    "vertex_error_mm": 1,
    "acceleration_error_m_s2": 2,
    "predicted_to_true_mm": 1,
    "true_to_predicted_mm": 1,
    "to_cloud_mm": 2,
    "segmentation_accuracy": 1,
    "inside_share": 2,
    "inside_1cm_share": 2,
    "inside_depth_mm": 1,
    "inference_s_per_frame": 1,
}
_SCALE = {
    "segmentation_accuracy": 100,
    "inside_share": 100,
    "inside_1cm_share": 100,
    "inference_s_per_frame": 1000,
}
# Setting of the experiment -> how a model with it departs from the paper's.
DEPARTURES = {
    "body_relative_points": (
        "Every point also says where on the body it is: where it would be if it had rested together"
        " with the nearest body vertex, and its height above that vertex. Labels are given a map of"
        " the body with the mean height of the points on each part. The network's alpha is added to"
        " the result of a ridge regression on such maps, which also show which points belong to the"
        " garment. All of this is ours, not the paper's. It applies to PN++, whose maps do not show"
        " the garment's points, and to everything that is built on the canonical network."
    ),
    "balance": (
        "In the loss of the labels, points weigh more the rarer their label is among the training"
        " points; in the paper all weigh the same."
    ),
    "pull_neighbours": (
        "In each iteration, vertices are also drawn towards the nearest garment points by a learned"
        " share; the paper's network is not told where these points are. The row with displacements"
        " as in the paper, if there is one, was trained without this."
    ),
    "smooth_passes": (
        "In the end, the displacements of a whole sequence are averaged over neighbouring frames,"
        " which the paper does not do. Those of MGN*, and those as in the paper, are not averaged."
    ),
}
# Hong, Pan, Cai and Liu, Garment4D: Garment Reconstruction from Point Cloud Sequences, NeurIPS
# 2021: per type in this order. Table 5 is of licensed scans.
_PAPER_TYPES = ("Skirt", "Tshirt", "Trousers")
_PAPER_2 = {"pointnet": (33.71, 41.05, 20.80), "canonical": (30.23, 28.39, 18.16)}
_PAPER_3 = {
    "lbs": (79.52, 44.55, 31.05),
    "mgn": (71.66, 40.54, 29.12),
    "posed": (49.39, 37.83, 26.48),
}
_PAPER_4 = {"mgn": (12.59, 7.173, 4.135), "posed": (3.273, 4.749, 2.520)}
_PAPER_TABLES = (
    ("2", "canonical_error_mm", "Table 2: canonical garments, M1 (mm)", _PAPER_2, _CANONICAL),
    ("3", "vertex_error_mm", "Table 3: posed garments, M2 (mm)", _PAPER_3, _POSED),
    ("4", "acceleration_error_m_s2", "Table 4: acceleration, M3 (m/s²)", _PAPER_4, _POSED),
)
# Figure 6: what leaving a part out adds to the errors in mm and in m/s^2.
_PAPER_ABLATIONS = {
    "no_body_encoder": (8.42, None),
    "no_transformer": (2.21, 5.575),
    "nearest_weights": (7.1, None),
}


def _table(
    rows: Sequence[MetricRow], names: Mapping[str, str], metric: str, *, best: bool = True
) -> str:
    """One row per model that has the metric, one column per garment type."""
    garments = garment_columns(rows)
    values = {
        variant: [find_value(rows, variant, "test", garment, metric) for garment in garments]
        for variant in names
    }
    found = [variant for variant, own in values.items() if any(own)]
    compared = [variant for variant in found if variant not in _FLOORS]
    choose = max if metric == "segmentation_accuracy" else min
    best_of = [
        choose((values[v][k].value for v in compared if values[v][k]), default=None)
        for k in range(len(garments))
    ]
    table = []
    for variant in found:
        line: dict[str, object] = {"Model": names[variant]}
        for k, garment in enumerate(garments):
            own = values[variant][k]
            leads = best and len(compared) > 1 and own and own.value == best_of[k]
            good = ["good"] if leads and variant in compared else []
            line[garment] = Cell(_text(rows, variant, garment, metric), "number", *good)
        counts = [str(own.n) if own else "-" for own in values[variant]]
        line["Sequences"] = Cell(" / ".join(counts), "number")
        table.append(line)
    return html_table(table)


def _text(
    rows: Sequence[MetricRow], variant: str, garment: str, metric: str, source: str = ""
) -> str:
    """A value, its interval behind it, or a dash."""
    value, low, high = (
        find_value(rows, variant, "test", garment, metric + end, source) for end in ("", LOW, HIGH)
    )
    if value is None:
        return "-"
    scale, digits = _SCALE.get(metric, 1), _DIGITS[metric]
    text = f"{scale * value.value:.{digits}f}"
    if low and high:
        text += f" [{scale * low.value:.{digits}f}, {scale * high.value:.{digits}f}]"
    return text


def _contact(rows: Sequence[MetricRow]) -> str:
    titles = {
        "inside_share": "Inside the body (%)",
        "inside_1cm_share": "Deeper than 1 cm (%)",
        "inside_depth_mm": "Deepest of a frame (mm)",
    }
    table = [
        {
            "Garment": garment,
            "Model": name,
            **{
                title: Cell(_text(rows, variant, garment, metric), "number")
                for metric, title in titles.items()
            },
        }
        for garment in garment_columns(rows)
        for variant, name in _CONTACT.items()
        if find_value(rows, variant, "test", garment, "inside_share")
    ]
    return html_table(table)


def _by_source(rows: Sequence[MetricRow]) -> str:
    """M1, M2 and distances between surfaces on the samples of each solver; nothing if only one."""
    table = [
        {
            "Samples": source,
            "Measure": title,
            "Model": name,
            **{
                garment: Cell(_text(rows, variant, garment, metric, source), "number")
                for garment in garment_columns(rows)
            },
        }
        for source in sorted({row.source for row in rows} - {""})
        for metric, title, names in (
            ("canonical_error_mm", "M1 (mm)", _CANONICAL),
            ("vertex_error_mm", "M2 (mm)", _POSED),
            ("predicted_to_true_mm", "to the true surface (mm)", _POSED),
            ("acceleration_error_m_s2", "M3 (m/s²)", _MOVING),
        )
        for variant, name in names.items()
        if any(row[1] == variant and row.metric == metric and row.source == source for row in rows)
    ]
    return html_table(table)


def _pairs(rows: Sequence[MetricRow], names: Mapping[str, str]) -> str:
    """Vertex and acceleration error of each model and type; the latter may be unknown."""
    table, garments = [], garment_columns(rows)
    for variant, name in names.items():
        cells = {}
        for garment in garments:
            both = [
                find_value(rows, variant, "test", garment, metric)
                for metric in ("vertex_error_mm", "acceleration_error_m_s2")
            ]
            if both[0]:
                acceleration = f"{both[1].value:.2f}" if both[1] else "-"
                cells[garment] = f"{both[0].value:.1f} / {acceleration}"
        if cells:
            shown = {g: Cell(cells.get(g, "-"), "number") for g in garments}
            table.append({"Model": name, **shown})
    return html_table(table)


def _sweeps(rows: Sequence[MetricRow]) -> str:
    """Vertex errors of the variants that end in a number, in rising order."""
    table = []
    for prefix, form in (
        ("neighbours", "K = {}"),
        ("missing", "{} % of the points missing"),
        ("accuracy", "{} % of the labels right"),
    ):
        numbers = {
            row.variant.removeprefix(prefix + "_")
            for row in rows
            if row.variant.startswith(prefix + "_") and row.metric == "vertex_error_mm"
        }
        for number in sorted(numbers, key=float):
            variant = f"{prefix}_{number}"
            cells = {
                garment: Cell(_text(rows, variant, garment, "vertex_error_mm"), "number")
                for garment in garment_columns(rows)
            }
            table.append({"Changed": form.format(number), **cells})
    return html_table(table)


class Section(NamedTuple):
    """A part of the page.

    Attributes:
        title: heading.
        table: HTML of the rows of the test split.
        about: paragraph between heading and table, or nothing.
    """

    title: str
    table: Callable[[Sequence[MetricRow]], str]
    about: str = ""

    def html(self, rows: Sequence[MetricRow]) -> str:
        """Heading, paragraph and table."""
        about = f"<p>{self.about}</p>\n" if self.about else ""
        return f"<h2>{self.title}</h2>\n{about}{self.table(rows)}"


# What the page shows of the metrics, in order.
_SECTIONS = (
    Section(
        "Table 2: canonical garments, vertex error M1 (mm)",
        partial(_table, names=_CANONICAL, metric="canonical_error_mm"),
        "Both the losses and M1 measure against the registered garment, not the original.",
    ),
    Section(
        "Distance to the garment as simulated (mm)",
        partial(_table, names=_CANONICAL, metric="canonical_to_original_mm"),
        "M1 does not see what registration loses. These are distances between surfaces, over"
        " their area, to the garment before registration; the last row is what registration"
        " alone loses.",
    ),
    Section(
        "Points with the right label (%)",
        partial(_table, names=_LABELS, metric="segmentation_accuracy"),
    ),
    Section(
        "Table 3: posed garments, vertex error M2 (mm)",
        partial(_table, names=_POSED, metric="vertex_error_mm"),
    ),
    Section(
        "From the reconstructed surface to the true one (mm)",
        partial(_table, names=_POSED, metric="predicted_to_true_mm"),
        "M2 also counts vertices that lie on the true surface but beside their place. This is the"
        " mean distance of the reconstruction's vertices from the true surface, in every fifth"
        " frame; the next table is the other way.",
    ),
    Section(
        "From the true surface to the reconstructed one (mm)",
        partial(_table, names=_POSED, metric="true_to_predicted_mm"),
    ),
    Section(
        "Table 4: acceleration error M3 (m/s²)",
        partial(_table, names=_MOVING, metric="acceleration_error_m_s2"),
    ),
    Section(
        "By cloth solver",
        _by_source,
        "The same measures on the samples of each solver. The networks saw samples of all of them"
        " in training.",
    ),
    Section(
        "Table 5: distance of vertices to the cloud, one way (mm)",
        partial(_table, names=_CONTACT, metric="to_cloud_mm", best=False),
        "To the whole cloud, skin included. On clouds with holes this distance rises wherever"
        " points are missing, even for a perfect garment; the first row, the ground truth,"
        " shows by how much.",
    ),
    Section("Vertices inside the body", _contact),
    Section(
        "Ablations (figure 6) and inputs: M2 (mm) / M3 (m/s²)",
        partial(_pairs, names=_ABLATIONS),
        "The model with weights of the nearest body vertex was trained on such proposals, which"
        " are not smoothed either. The row with mesh vertices is the full model, which learned"
        " from points on surfaces, given points as the released code samples them.",
    ),
    Section(
        "Neighbours, holes and wrong labels (figures 8 to 10): M2 (mm)",
        _sweeps,
        "All by the full model, trained once. For other K only its proposals change, and their"
        " weights are smoothed for every K, even K = 1.",
    ),
    Section(
        "With an inexact body: M1 (mm)",
        partial(_table, names=_NOISY, metric="canonical_error_mm"),
        "With noise on pose and shape. Canonical networks whose points do not say where on the"
        " body they are never look at the body, and have no row.",
    ),
    Section("With an inexact body: M2 (mm) / M3 (m/s²)", partial(_pairs, names=_NOISY)),
    Section(
        "Time per frame (ms)",
        partial(_table, names=_POSED, metric="inference_s_per_frame"),
        "For everything from the points to the garment.",
    ),
)


def write_garment4d_page(
    path: str | Path,
    metrics: str | Path,
    registration: Iterable[str | Path] = (),
    departures: Iterable[str] = (),
) -> None:
    """Write the page of tables.

    Args:
        path: the HTML page.
        metrics: table of metrics; models that it does not hold have no row.
        registration: tables of errors of garments registered to templates.
        departures: keys of `DEPARTURES` that hold for the models.

    Raises:
        InputError: a table is missing or unusable.
    """
    rows = _test_rows(metrics)
    residuals = [row for part in registration for row in read_table(part, COLUMNS)]
    write_page(
        path,
        "Garment4D: tables 2 to 5, for this dataset",
        "<p>Test split, which only evaluation reads. Means over whole sequences, all of one weight,"
        " with 95 % intervals from resampling sequences where there are three or more. The smallest"
        " error of a column, or the largest share of right labels, is green. All models are given"
        " the pose and shape of the body, as in the released code;"
        " <code>snakemake garment4d_ablations</code> adds tables of what a noisy body does.</p>",
        *(f"<p>{DEPARTURES[name]}</p>" for name in departures),
        *(section.html(rows) for section in _SECTIONS),
        "<h2>Registration to the templates</h2>",
        "<p>Mean distances between a garment and its copy in the template's topology. The goal is"
        f" below {REGISTRATION_TARGET_MM:g} mm, with no face flipped.</p>",
        html_table(_registration(residuals)),
        f"<h2>{THEIRS}</h2>",
        "<p>As printed. The paper's garments, bodies, registration and number of sequences are"
        " different, its clouds are mesh vertices, and its best checkpoint was chosen on the"
        " sequences that it reports: none of this can be compared with the tables above. Its table"
        " 5 is about licensed scans and is not repeated.</p>",
        *(
            f"<h3>{title}</h3>\n" + html_table(_paper(printed, names))
            for _, _, title, printed, names in _PAPER_TABLES
        ),
        "<h3>Figure 6: error added by leaving a part out</h3>",
        html_table(_paper_ablations()),
    )


def _test_rows(metrics: str | Path) -> list[MetricRow]:
    return [row for row in read_metrics(metrics) if row.model == MODEL and row.split == "test"]


def _registration(rows: Sequence[Mapping[str, str]]) -> list[dict[str, Cell]]:
    """One row per type and one column per metric: means, of whole numbers sums."""
    wide: dict[str, dict[str, Cell]] = {}
    for row in summarise_errors(rows, "template"):
        counted = row["unit"] == "count"
        shown = float(row["total" if counted else "mean"])
        good = shown == 0 if counted else shown <= REGISTRATION_TARGET_MM
        line = wide.setdefault(
            row["garment"],
            {"Garment": Cell(row["garment"]), "Garments": Cell(row["garments"], "number")},
        )
        title = row["metric"].replace("_", " ").removesuffix(" mm").capitalize()
        title += ", total" if counted else " (mm)"
        text = f"{shown:.0f}" if counted else f"{shown:.2f}, at most {float(row['max']):.2f}"
        line[title] = Cell(text, "number", "good" if good else "bad")
    return list(wide.values())


def _paper(
    printed: Mapping[str, Sequence[float]], names: Mapping[str, str]
) -> list[dict[str, object]]:
    return [
        {
            THEIRS: names[variant],
            **{
                garment: Cell(value, "number", "theirs")
                for garment, value in zip(_PAPER_TYPES, values, strict=True)
            },
        }
        for variant, values in printed.items()
    ]


def _paper_ablations() -> list[dict[str, object]]:
    titles = ("Vertex error (mm)", "Acceleration error (m/s²)")
    return [
        {
            THEIRS: _ABLATIONS[variant],
            **{
                title: Cell("-" if value is None else f"+{value:g}", "number", "theirs")
                for title, value in zip(titles, values, strict=True)
            },
        }
        for variant, values in _PAPER_ABLATIONS.items()
    ]


def write_beside_paper(path: str | Path, metrics: str | Path) -> None:
    """Write a tab-separated table with our errors and the paper's in two columns.

    Raises:
        InputError: the table of metrics is missing or unusable.
    """
    rows = _test_rows(metrics)
    with atomic_file(path) as scratch, open(scratch, "w", newline="") as stream:
        writer = csv.writer(stream, delimiter="\t", lineterminator="\n")
        writer.writerow(("table", "row", "metric", OURS, THEIRS))
        for table, metric, _, printed, _ in _PAPER_TABLES:
            for variant, values in printed.items():
                for garment, theirs in zip(_PAPER_TYPES, values, strict=True):
                    ours = find_value(rows, variant, "test", garment, metric)
                    mine = f"{ours.value:.5g}" if ours else "-"
                    writer.writerow((table, f"{variant} {garment}", metric, mine, theirs))
