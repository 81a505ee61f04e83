"""A garment from a user's scans: all stages on one sequence, and its metrics.

F frames, N vertices of the garment.
"""

from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.scans import ScanSequence
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics import sequence as metrics
from drapeline.metrics.reconstructions import Reconstruction
from drapeline.metrics.table import ALL, MetricRow
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.garment4d.reconstruct import (
    ReconstructedGarment,
    build_reconstruction,
    reconstruct,
    refine,
    training_worn_statistics,
)
from drapeline.models.garment4d.refine import RefineSettings
from drapeline.models.garment4d.windows import BodySequences
from drapeline.rule_log import LOGGER

SPLIT = "scans"
# In simulated clouds of every type at least every sixth point is the garment's, while networks
# label single points as a garment that is not there.
_LEAST_SHARE = 0.02
_SHOWN = 48  # frames of the sequence that pictures are made of, at most


class ScannedGarment(NamedTuple):
    """A garment reconstructed from scans; metres, root frame.

    Attributes:
        canonical: (N, 3).
        final: (F, N, 3) of our last step.
        rows: of the table of metrics.
        shown: some frames with all stages, for figures.
    """

    canonical: np.ndarray
    final: np.ndarray
    rows: list[MetricRow]
    shown: Reconstruction


def reconstruct_scans(
    scans: ScanSequence,
    stage: PosedStage,
    sequences: BodySequences,
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
        sequences: that it was trained on.
        refining: of our last step.
        name: of the scans, for errors and pictures.
        points: number per cloud that the networks are given.
        seed: of their choice.

    Raises:
        InputError: there are fewer frames than in a window, or hardly any of the garment's points.
    """
    motion, faces, garment = scans.body, stage.space.faces, sequences.data.garment_type
    clouds = scans.points(points, seed=seed)
    body = sequences.bodies.of(GENDERS.index(motion.gender), motion.shape)
    made = reconstruct(stage, clouds, motion.poses, body)
    check_labels(name, made.labels == stage.label, garment)
    worn_statistics = training_worn_statistics(sequences, stage.settings.skinning)
    final = refine(made, clouds, motion.poses, body, stage.label, faces, refining, worn_statistics)
    some = np.arange(0, len(final), -(-len(final) // _SHOWN))
    shown = build_reconstruction(
        ReconstructedGarment(
            made.labels[some], made.canonical, made.proposal[some], final[some], 0.0
        ),
        name=name,
        garment=garment,
        faces=faces,
        points=clouds[some],
        poses=motion.poses[some],
        body=body,
        number=some,
    )
    rows = _measure(scans, body, garment, made, final, seed)
    return ScannedGarment(made.canonical, final, rows, shown)


def check_labels(name: str, chosen: np.ndarray, garment: str) -> None:
    """Refuse scans in which the network finds no such garment: it would return the mean garment.

    Args:
        name: of the scans.
        chosen: (F, P) bool, the points that it labels as the garment's.
        garment: its type.

    Raises:
        InputError: over all frames they are less than two per cent.
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


def _measure(
    scans: ScanSequence,
    body: PosedBody,
    garment: str,
    made: ReconstructedGarment,
    final: np.ndarray,
    seed: int,
) -> list[MetricRow]:
    """Table 5 for the proposals, the posed stage and our last step, against the whole scans."""

    def body_vertices(frame: int) -> np.ndarray:
        return posed_vertices(body.model, body.shape, scans.body.poses[frame][None])[0][0]

    rows = []
    steps = {"lbs": made.proposal, "posed": made.final, "ours": final}
    for variant, vertices in steps.items():
        measures = metrics.sequence_measures(
            vertices,
            body=metrics.MovingBody(body_vertices, body.model.faces),
            points=[scan.points for scan in scans.scans],
        )
        one = metrics.Measured(SPLIT, garment, measures)
        rows += metrics.sequence_summary([one], variant=variant, split=SPLIT, seed=seed)
    return [row for row in rows if row.garment != ALL]
