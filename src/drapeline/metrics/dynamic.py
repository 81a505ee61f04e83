"""Predicted garments in motion, measured against their simulated ground truth."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.garment import garment_measures, garment_mesh, inside_measures
from drapeline.metrics.table import MetricRow, by_source, summary_rows
from drapeline.registration.to_body.topology import Topology
from drapeline.seeding import rng_for

CONTACT_STEP = 5  # of the frames in which contact with the body is measured


def measure_motion(
    moving: MovingGarment,
    frames: np.ndarray,
    predicted: np.ndarray,
    body: BodyModel,
    topology: Topology,
) -> list[dict[str, float]]:
    """Metrics of frames of one garment; those of what is inside the body for every fifth frame.

    Args:
        frames: (n,) to measure.
        predicted: (n, M, 3) registered points, root-relative metres.
        body: super-resolved, of the wearer's gender.
        topology: of the super-resolved bodies.
    """
    faces, mask = topology.faces_of(moving.name), moving.registered.mask
    all_measures = []
    for points, true in zip(predicted, moving.points(frames), strict=True):
        vertices = moving.on_vertices(points)
        # A garment in motion has its static mask, which no model predicts.
        measures = garment_measures(vertices, None, moving.on_vertices(true), mask, faces)
        all_measures.append(measures)
    inside = measure_inside(moving, frames, predicted, body, topology)
    return [measures | more for measures, more in zip(all_measures, inside, strict=True)]


def measure_inside(
    moving: MovingGarment,
    frames: np.ndarray,
    predicted: np.ndarray,
    body: BodyModel,
    topology: Topology,
) -> list[dict[str, float]]:
    """`inside_measures` of every `CONTACT_STEP`-th of the frames, nothing of the others.

    Args:
        moving, frames, predicted, body, topology: see `measure_motion`.
    """
    faces, mask = topology.faces_of(moving.name), moving.registered.mask
    measured: list[dict[str, float]] = [{} for _ in frames]
    for index in range(0, len(frames), CONTACT_STEP):
        pose = moving.poses[frames[index]][None]
        posed = posed_vertices(body, moving.shape, pose)[0][0]
        worn = garment_mesh(moving.on_vertices(predicted[index]), faces, mask)
        measured[index] = inside_measures(worn.vertices, posed, topology.faces)
    return measured


class Measured(NamedTuple):
    """Metrics of the frames of one garment.

    Attributes:
        sample, garment: name and type.
        source: cloth solver that moved it.
        rows: metric -> value, per frame.
    """

    sample: str
    garment: str
    source: str
    rows: Sequence[Mapping[str, float]]


def moving_summary(
    measured: Sequence[Measured],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
) -> list[MetricRow]:
    """Rows of the table of metrics over all frames; samples are resampled as a whole."""
    return [
        row
        for source, own in by_source(measured).items()
        for row in summary_rows(
            rng_for(seed, "intervals", variant, split, source),
            [row for garment in own for row in garment.rows],
            [garment.garment for garment in own for _ in garment.rows],
            [garment.sample for garment in own for _ in garment.rows],
            model=model,
            variant=variant,
            split=split,
            seed=seed,
            source=source,
        )
    ]
