"""Predicted garments in rest pose, measured against their registered ground truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drapeline.metrics.garment import (
    garment_measures,
    garment_mesh,
    shape_measures,
)
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for

# Offsets (V, 3) in metres, and mask (V,) or None from a model that predicts none.
Prediction = tuple[np.ndarray, np.ndarray | None]


@dataclass(frozen=True)
class Truth:
    """Registered garments in rest pose, row by row.

    Attributes:
        offsets: (N, V, 3) metres; may be memory-mapped.
        mask: (N, V) bool.
        body: row -> rest body (V, 3), metres.
        faces: row -> (F, 3) of the topology of the row's garment.
        body_faces: (F, 3) of the body itself.
    """

    offsets: np.ndarray
    mask: np.ndarray
    body: Callable[[int], np.ndarray]
    faces: Callable[[int], np.ndarray]
    body_faces: np.ndarray


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


def measure_truth(truth: Truth, rows: Sequence[int]) -> list[dict[str, float]]:
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


class StaticRows(Protocol):
    """Registered garments in rest pose, with their outfits, types and splits."""

    offsets: np.ndarray
    mask: np.ndarray
    garment: np.ndarray
    outfit: np.ndarray

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions."""


def static_summary(
    garments: StaticRows,
    rows: np.ndarray,
    measures: Sequence[Mapping[str, float]],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
) -> list[MetricRow]:
    """Rows of the table of metrics; garments of one outfit are resampled together."""
    return summary_rows(
        rng_for(seed, "intervals", variant, split),
        measures,
        [GARMENTS[garment_index] for garment_index in garments.garment[rows]],
        garments.outfit[rows],
        model=model,
        variant=variant,
        split=split,
        seed=seed,
    )
