"""Measure predicted garments of a split against their registered ground truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drapeline.metrics.garment_metrics import garment_measures, garment_mesh, shape_measures

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

    The shape of a garment without a predicted mask is judged within the true one.
    """
    found = []
    for row, (offsets, mask) in predictions:
        body, faces, true_mask = truth.body(row), truth.faces(row), truth.mask[row]
        vertices = body + offsets
        shape = garment_mesh(vertices, faces, true_mask if mask is None else mask)
        found.append(
            {
                **garment_measures(vertices, mask, body + truth.offsets[row], true_mask, faces),
                **shape_measures(shape, body, truth.body_faces),
            }
        )
    return found


def measure_truth(truth: Truth, rows: Sequence[int]) -> list[dict[str, float]]:
    """What the ground truth itself reaches of the metrics that need no comparison."""
    return [
        shape_measures(
            garment_mesh(truth.body(row) + truth.offsets[row], truth.faces(row), truth.mask[row]),
            truth.body(row),
            truth.body_faces,
        )
        for row in rows
    ]


def with_kl(measures: Sequence[Mapping[str, float]], kl: np.ndarray) -> list[dict[str, float]]:
    """The measures with each garment's KL (n,) in nats."""
    return [{**row, "kl": float(value)} for row, value in zip(measures, kl, strict=True)]
