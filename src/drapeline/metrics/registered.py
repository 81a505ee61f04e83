"""Predicted garments at rest and in motion, measured against their registered ground truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.garment import (
    CONTACT_STEP,
    garment_measures,
    garment_mesh,
    inside_measures,
    shape_measures,
)
from drapeline.metrics.metric import Measured
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import Topology

# Offsets (V, 3) in metres, and mask (V,) or None from a model that predicts none.
Prediction = tuple[np.ndarray, np.ndarray | None]


@dataclass(frozen=True)
class Truth:
    """Registered garments in rest pose, row by row."""

    offsets: np.ndarray  # (N, V, 3) metres; may be memory-mapped
    mask: np.ndarray  # (N, V) bool
    body: Callable[[int], np.ndarray]  # row -> rest body (V, 3), metres
    faces: Callable[[int], np.ndarray]  # row -> (F, 3) of the topology of the row's garment
    body_faces: np.ndarray  # (F, 3) of the body itself


def measure_predictions(
    truth: Truth, predictions: Iterable[tuple[int, Prediction]]
) -> list[dict[str, float]]:
    """Every metric of each (row, prediction).

    Without a predicted mask, the shape of a garment is measured within the true one.
    """
    measures = []
    for row, (offsets, mask) in predictions:
        body, faces, true_mask = truth.body(row), truth.faces(row), truth.mask[row]
        vertices = body + offsets
        shape = garment_mesh(vertices, faces, true_mask if mask is None else mask)
        measures.append(
            {
                **garment_measures(vertices, mask, body + truth.offsets[row], true_mask, faces),
                **shape_measures(shape, body, truth.body_faces),
            }
        )
    return measures


def measure_truth(truth: Truth, rows: Iterable[int]) -> list[dict[str, float]]:
    """Measures of the ground truth itself, those that need no comparison."""
    measures = []
    for row in rows:
        body = truth.body(row)
        mesh = garment_mesh(body + truth.offsets[row], truth.faces(row), truth.mask[row])
        measures.append(shape_measures(mesh, body, truth.body_faces))
    return measures


def add_kl(measures: Sequence[Mapping[str, float]], kl: np.ndarray) -> list[dict[str, float]]:
    """Add each garment's KL (n,) in nats to its measures."""
    return [{**row, "kl_nat": float(value)} for row, value in zip(measures, kl, strict=True)]


class OutfitRows(Protocol):
    """Garments of outfits: the type of each, and its outfit."""

    garment: np.ndarray
    outfit: np.ndarray


class StaticRows(OutfitRows, Protocol):
    """Registered garments in rest pose, with their outfits, types and splits."""

    offsets: np.ndarray
    mask: np.ndarray

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions."""


def measured_at_rest(
    garments: OutfitRows, rows: np.ndarray, measures: Sequence[Mapping[str, float]]
) -> list[Measured]:
    """Measures of rows of the dataset, with their types; those of one outfit are dependent."""
    return [
        Measured(outfit, GARMENTS[index], values)
        for outfit, index, values in zip(
            garments.outfit[rows].tolist(), garments.garment[rows], measures, strict=True
        )
    ]


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
    """`inside_measures` of every `CONTACT_STEP`-th frame, None of others; see `measure_motion`."""
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
    """Measures of frames of one garment; those of one clip are dependent, whoever moves in it."""
    return [Measured(moving.clip, moving.name, values, moving.source) for values in measures]
