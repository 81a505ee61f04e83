"""A garment from a user's scans: all stages on one sequence, and what there is to say of it.

F frames, N vertices of the garment.
"""

from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.scans import ScanSequence
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics import sequence as metrics
from drapeline.metrics.table import ALL, MetricRow
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.garment4d.reconstruct import (
    Reconstruction,
    pictured,
    reconstruct,
    refine,
    training_habits,
)
from drapeline.models.garment4d.refine import RefineSettings
from drapeline.rule_log import LOGGER

SPLIT = "scans"
# In simulated clouds of every type at least every sixth point is the garment's, while a network
# takes single points for one that is not there.
_LEAST_SHARE = 0.02
_SHOWN = 48  # frames of the sequence that pictures are made of, at most


class ScannedGarment(NamedTuple):
    """What the networks make of scans; metres, root frame.

    Attributes:
        canonical: (N, 3).
        final: (F, N, 3) of our last step.
        rows: of the table of metrics.
        shown: some frames with all stages, for pictures.
    """

    canonical: np.ndarray
    final: np.ndarray
    rows: list[MetricRow]
    shown: metrics.Reconstruction


def reconstruct_scans(
    scans: ScanSequence,
    stage: PosedStage,
    data: SequenceData,
    refining: RefineSettings,
    *,
    name: str,
    points: int,
    seed: int,
) -> ScannedGarment:
    """The garment of a stage's type in scans.

    Args:
        scans: with the body.
        stage: trained; it holds the canonical network.
        data: that it was trained on.
        refining: of our last step.
        name: of the scans, for errors and pictures.
        points: of each cloud that the networks see.
        seed: draws them.

    Raises:
        InputError: there are fewer frames than a window has, or next to no point is of the garment.
    """
    body, faces = scans.body, stage.space.faces
    clouds = scans.points(points, seed=seed)
    wearer = data.wearers.of(GENDERS.index(body.gender), body.shape)
    made = reconstruct(stage, clouds, body.poses, wearer)
    check_labels(name, made.labels == stage.label, data.kind)
    habits = training_habits(data, stage.settings.skinning)
    final = refine(made, clouds, body.poses, wearer, stage.label, faces, refining, habits)
    some = np.arange(0, len(final), -(-len(final) // _SHOWN))
    shown = pictured(
        Reconstruction(made.labels[some], made.canonical, made.proposal[some], final[some], 0.0),
        name=name,
        garment=data.kind,
        faces=faces,
        points=clouds[some],
        poses=body.poses[some],
        wearer=wearer,
        number=some,
    )
    rows = _measured(scans, wearer, data.kind, made, final, seed)
    return ScannedGarment(made.canonical, final, rows, shown)


def check_labels(name: str, chosen: np.ndarray, garment: str) -> None:
    """Refuse scans in which the network finds no such garment; it would give a mean one.

    Args:
        name: of the scans.
        chosen: (F, P) bool, which points it takes for the garment's.
        garment: its type.

    Raises:
        InputError: over all frames they are fewer than two in a hundred.
    """
    if chosen.mean() < _LEAST_SHARE:
        raise InputError(
            f"{name}: {chosen.mean():.1%} of the points are taken for {garment}, expected"
            f" {_LEAST_SHARE:.0%} or more: a person who wears one, and a network trained on"
            " clouds like these"
        )
    for frame in np.flatnonzero(chosen.mean(axis=1) < _LEAST_SHARE):
        LOGGER.warning(
            "%s: frame %d: %.1f %% of the points are taken for %s; it follows other frames there",
            name,
            frame + 1,
            100 * chosen[frame].mean(),
            garment,
        )


def _measured(
    scans: ScanSequence,
    wearer: PosedBody,
    garment: str,
    made: Reconstruction,
    final: np.ndarray,
    seed: int,
) -> list[MetricRow]:
    """Table 5 of the proposals, of the posed stage and of our last step, against whole scans."""

    def body(frame: int) -> np.ndarray:
        return posed_vertices(wearer.model, wearer.shape, scans.body.poses[frame][None])[0][0]

    rows = []
    steps = {"lbs": made.proposal, "posed": made.final, "ours": final}
    for variant, vertices in steps.items():
        measures = metrics.sequence_measures(
            vertices,
            wearer=metrics.PosedBody(body, wearer.model.faces),
            points=[scan.points for scan in scans.scans],
        )
        one = metrics.Measured(SPLIT, garment, measures)
        rows += metrics.sequence_summary([one], variant=variant, split=SPLIT, seed=seed)
    return [row for row in rows if row.garment != ALL]
