"""Predictions of garments in motion that need no network, and their metrics."""

from collections.abc import Iterable, Mapping

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.dynamic import Measured, measure_inside, measure_motion, moving_summary
from drapeline.metrics.table import MetricRow
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import (
    dynamic_offsets,
    points_from_offsets,
)
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress

STILL, MEAN = "skinned_static", "skinned_mean"


def mean_wrinkles(
    garments: Iterable[MovingGarment], bodies: Mapping[str, BodyModel], step: int
) -> np.ndarray:
    """(types, V, 3) mean pose-invariant offsets of training garments, per type and vertex.

    Args:
        garments: read one after the other.
        bodies: super-resolved, by gender.
        step: of the frames that count.

    Raises:
        InputError: there are none.
    """
    vertices = len(next(iter(bodies.values())).v_template)
    total = np.zeros((len(GARMENTS), vertices, 3))
    count = np.zeros((len(GARMENTS), vertices, 1))
    for moving in progress(garments, label="mean wrinkles"):
        frames = np.arange(0, len(moving.poses), step)
        offsets = dynamic_offsets(
            moving.registered,
            moving.cloth[frames],
            bodies[moving.gender],
            moving.shape,
            moving.poses[frames],
            "unposed",
        )
        garment_index = GARMENTS.index(moving.name)
        total[garment_index] += offsets.sum(axis=0)
        count[garment_index] += len(frames) * moving.registered.mask[:, None]
    if not count.any():
        raise InputError("no sample of the training split was accepted, expected one or more")
    return (total / np.maximum(count, 1)).astype(np.float32)


def moving_baseline_summary(
    training: Iterable[MovingGarment],
    held_out: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    *,
    step: int,
    seed: int,
) -> list[MetricRow]:
    """The static garment skinned by its weights, without and with the type's mean wrinkles.

    Args:
        training: garments that the mean wrinkles are computed from.
        held_out: split -> garments to measure.
        bodies: super-resolved, by gender.
        step: of the frames measured, and of those that the mean is computed from.
        seed: of the intervals.
    """
    mean = mean_wrinkles(training, bodies, step)
    found = []
    for split, garments in held_out.items():
        measured: dict[str, list[Measured]] = {"moving": [], STILL: [], MEAN: []}
        for moving in progress(garments, label=split):
            body, frames = bodies[moving.gender], np.arange(0, len(moving.poses), step)
            wrinkles = mean[GARMENTS.index(moving.name)] * moving.registered.mask[:, None]
            for name, offsets in ((STILL, np.zeros_like(wrinkles)), (MEAN, wrinkles)):
                points = points_from_offsets(
                    moving.registered,
                    np.broadcast_to(offsets, (len(frames), *offsets.shape)),
                    body,
                    moving.shape,
                    moving.poses[frames],
                    "unposed",
                )
                rows = measure_motion(moving, frames, points, body, topology)
                measured[name].append(Measured(moving.sample, moving.name, moving.source, rows))
            inside = measure_inside(moving, frames, moving.points(frames), body, topology)
            measured["moving"].append(Measured(moving.sample, moving.name, moving.source, inside))
        for name, rows in measured.items():
            model = "truth" if name == "moving" else "baseline"
            found += moving_summary(rows, model=model, variant=name, split=split, seed=seed)
    return found
