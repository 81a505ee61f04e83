"""A garment from a user's scans: all stages on one sequence, and its metrics.

F frames, N vertices of the garment.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.scans import ScanSequence
from drapeline.metrics import sequence as metrics
from drapeline.metrics.garment4d import MODEL
from drapeline.metrics.metric import Measured
from drapeline.metrics.reconstructions import Reconstruction
from drapeline.metrics.table import join, summarise, without_all
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.reconstruct import ReconstructedGarment, build_reconstruction
from drapeline.models.garment4d.reconstruction_model import ReconstructionModel
from drapeline.registration.settings import RefineSettings
from drapeline.schema import Table

SPLIT = "scans"
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
    rows: Table
    shown: Reconstruction


def reconstruct_scans(
    scans: ScanSequence,
    model: ReconstructionModel,
    refining: RefineSettings,
    *,
    name: str,
    seed: int,
) -> ScannedGarment:
    """The garment of a model's type in scans.

    Args:
        scans: with the body.
        model: trained.
        refining: of our last step.
        name: of the scans, for errors and pictures.
        seed: of the points that the networks are given.

    Raises:
        InputError: see `ReconstructionModel.reconstruct_steps`.
    """
    clouds, body, made, final = model.reconstruct_steps(scans, refining, name=name, seed=seed)
    some = np.arange(0, len(final), -(-len(final) // _SHOWN))
    shown = build_reconstruction(
        ReconstructedGarment(
            made.labels[some], made.canonical, made.proposal[some], final[some], 0.0
        ),
        name=name,
        garment=model.garment,
        faces=model.stage.space.faces,
        points=clouds[some],
        poses=scans.body.poses[some],
        body=body,
        number=some,
    )
    rows = _measure(scans, body, model.garment, made, final, seed)
    return ScannedGarment(made.canonical, final, rows, shown)


def _measure(
    scans: ScanSequence,
    body: PosedBody,
    garment: str,
    made: ReconstructedGarment,
    final: np.ndarray,
    seed: int,
) -> Table:
    """Table 5 for the proposals, the posed stage and our last step, against the whole scans."""

    @cache
    def body_vertices(frame: int) -> np.ndarray:
        return posed_vertices(body.model, body.shape, scans.body.poses[frame][None])[0][0]

    moving = metrics.MovingBody(body_vertices, body.model.faces)
    tables = []
    steps = {"lbs": made.proposal, "posed": made.final, "ours": final}
    for variant, vertices in steps.items():
        measures = metrics.sequence_measures(
            vertices,
            body=moving,
            points=[scan.points for scan in scans.scans],
        )
        one = Measured(SPLIT, garment, measures)
        tables.append(summarise([one], model=MODEL, variant=variant, split=SPLIT, seed=seed))
    return without_all(join(tables))
