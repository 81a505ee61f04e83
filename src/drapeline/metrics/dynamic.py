"""Predicted garments in motion, measured against their simulated ground truth."""

from collections.abc import Mapping, Sequence

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.garment import garment_measures, garment_mesh, inside_measures
from drapeline.metrics.metric import Measured
from drapeline.registration.to_body.topology import Topology

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


def measured_in_motion(
    moving: MovingGarment, measures: Sequence[Mapping[str, float]]
) -> list[Measured]:
    """Measures of frames of one garment; those of one sample are dependent."""
    return [Measured(moving.sample, moving.name, values, moving.source) for values in measures]
