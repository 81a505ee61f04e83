"""The page on which all systems stand side by side: one protocol, one table for each question."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from drapeline.metrics.cost import read_costs
from drapeline.metrics.properties import COMMON
from drapeline.metrics.registry import variant, variants
from drapeline.metrics.shared import CLEAN_SCAN, MOVED, REPRESENTATION, WORSE_SCAN
from drapeline.metrics.table import ALL, METRICS_FILE
from drapeline.report.html import number, write_page
from drapeline.report.models.comparisons import measured_variants
from drapeline.report.tables import MetricTable, Rows, Section, read_test_metrics
from drapeline.schema import Table

_DISTANCES = "surface_to_true_mm", "true_to_surface_mm"
_SURFACES = *_DISTANCES, "normal_error_deg", "openings_right"
_PICTURED = ("rest_to_true_mm", "true_to_rest_mm")
_IN_PAIRS = "smplicit_images_fitted_in_pair"  # of people half hidden, which nobody else is asked
PICTURE = "picture"
_OF_COSTS = (
    "Of a core, for one garment at rest or one garment in one frame; what a sequence takes is"
    " counted for the frame that is asked for, and registrations are not counted. Memory is the"
    " most that the job had taken by then, whatever it was for."
)


class Question(NamedTuple):
    """What systems are asked, and which rows of the table of metrics answer it."""

    model: str  # of the rows; those of pictures are of several
    title: str
    about: str


QUESTIONS = (
    Question(
        REPRESENTATION,
        "A garment at rest, through each code",
        "Every system holds the held-out garment in its own code and gives it back. Those that see"
        " nothing of it, the mean and the nearest training garment, have no code.",
    ),
    Question(
        MOVED,
        "Motion, predicted",
        "Each is told the true garment at rest, the wearer, and all poses up to the frame, and says"
        " where the cloth is. The last rows are simulations of the same: what is left to chance.",
    ),
    Question(
        CLEAN_SCAN,
        "A garment in motion, from exact points",
        "Each is given labelled points of a known body, exact and from all around; models of"
        " sequences have the frames before and after as well, those of single frames this one"
        " alone.",
    ),
    Question(
        WORSE_SCAN,
        "The same from one camera, with noise and holes",
        "The points are what one camera sees, noisy and with holes, and the body is estimated: all"
        " are given the same body, fitted to the skin among the points.",
    ),
    Question(
        PICTURE,
        "A garment at rest, from a picture",
        "The picture has labelled pixels, and the wearer's body and the camera are known. All types"
        " of garments count that a model knows.",
    ),
)


def write_systems_page(path: str | Path, evaluated: Sequence[str | Path]) -> None:
    """Write the page.

    Args:
        evaluated: folders of evaluations, with metrics and what these took.

    Raises:
        InputError: a table is missing or unusable.
    """
    measured = pd.concat([read_test_metrics(Path(one) / METRICS_FILE) for one in evaluated])
    costs = read_costs(evaluated)
    sections = [
        Section(question.title, table, question.about, by_source=True).html(part)
        for question in QUESTIONS
        for part, table in [answers(measured, question)]
        if len(part)
    ]
    about = (
        "Every system is asked the same questions on the same held-out samples, whose clips and"
        " bodies no model has seen. Distances are means over the area of surfaces, with 95 %"
        " intervals over clips, or over outfits at rest; an opening is a hem, a cuff or a neckline."
        " Systems do not know the same garments: the tables have those that all of them know."
        " What a system does not find at all has no distances, and openings that are not right. The"
        " best of each column is green."
    )
    write_page(
        path,
        "All systems on the same samples",
        f"<p>{about}</p>",
        *sections,
        Section("Time and memory", cost_rows(costs), _OF_COSTS).html(),
    )


def answers(measured: Table, question: Question) -> tuple[Table, MetricTable]:
    """The rows of a question, and the table of them: what does not compete comes last.

    Args:
        measured: see `read_test_metrics`.
        question: one of `QUESTIONS`.
    """
    if question.model == PICTURE:
        part = measured[measured["metric"].isin(_PICTURED) & (measured["variant"] != _IN_PAIRS)]
        names = [*variants("picture"), *variants("smplicit"), *part["variant"]]
        return part, MetricTable(list(dict.fromkeys(names)), _PICTURED)
    part = measured[measured["model"] == question.model]
    names = sorted(
        measured_variants(part, question.model),
        key=lambda name: not variant(question.model, name).competes,
    )
    if question.model == REPRESENTATION:
        digits = dict.fromkeys(_DISTANCES, 2)
        return part, MetricTable(names, ("code_numbers", *_SURFACES), digits=digits)
    return part[part["garment"] == COMMON].assign(garment=ALL), MetricTable(names, _SURFACES)


def cost_rows(costs: Table) -> Rows:
    """Rows of cells of what systems take, see `read_costs`."""
    return [
        {
            "Question": question.title,
            "Model": variant(row.model, row.variant).title,
            "Seconds of a core": number(f"{row.seconds:.2f}", order=row.seconds),
            "Garments": number(str(row.garments)),
            "Memory (MB)": number(f"{row.megabytes:.0f}", order=row.megabytes),
        }
        for question in QUESTIONS
        for row in costs[costs["model"] == question.model].itertuples()
        if row.seconds > 0
    ]
