"""Measure predicted garments of a split against their registered ground truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drapeline.metrics.baselines import static_baselines
from drapeline.metrics.garment import (
    garment_measures,
    garment_mesh,
    shape_measures,
)
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rule_log import progress
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
    found = []
    for row in rows:
        body = truth.body(row)
        mesh = garment_mesh(body + truth.offsets[row], truth.faces(row), truth.mask[row])
        found.append(shape_measures(mesh, body, truth.body_faces))
    return found


def add_kl(measures: Sequence[Mapping[str, float]], kl: np.ndarray) -> list[dict[str, float]]:
    """Add each garment's KL (n,) in nats to its measures."""
    return [{**row, "kl_nat": float(value)} for row, value in zip(measures, kl, strict=True)]


class StaticRows(Protocol):
    """Registered garments in rest pose, with what they are called and which split they are of."""

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
        [GARMENTS[kind] for kind in garments.garment[rows]],
        garments.outfit[rows],
        model=model,
        variant=variant,
        split=split,
        seed=seed,
    )


def static_baseline_summary(
    truth: Truth, garments: StaticRows, splits: Sequence[str], *, components: int, seed: int
) -> list[MetricRow]:
    """Trivial predictions and the ground truth itself, learned from the training split.

    Args:
        splits: to measure on.
        components: of the PCA, at most.
        seed: of the intervals.
    """
    everything = np.arange(len(garments.garment))
    predictors = static_baselines(
        garments.offsets,
        garments.mask,
        garments.garment,
        garments.cvar(everything),
        garments.rows("train"),
        types=len(GARMENTS),
        components=components,
    )
    found = []
    for split in splits:
        rows = garments.rows(split)
        measured = {"registered": measure_truth(truth, rows)}
        for name, predict in predictors.items():
            guessed = ((row, predict(row)) for row in progress(rows.tolist(), label=name))
            measured[name] = measure_predictions(truth, guessed)
        for name, measures in measured.items():
            found += static_summary(
                garments,
                rows,
                measures,
                model="truth" if name == "registered" else "baseline",
                variant=name,
                split=split,
                seed=seed,
            )
    return found
