"""Metrics of predictions that need no network: of garments at rest, and of those in motion."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.baselines import static_baselines
from drapeline.metrics.dynamic import measure_inside, measure_motion, measured_in_motion
from drapeline.metrics.metric import Measured
from drapeline.metrics.static import (
    StaticRows,
    Truth,
    measure_predictions,
    measure_truth,
    measured_at_rest,
)
from drapeline.metrics.table import join, summarise
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import (
    dynamic_offsets,
    points_from_offsets,
)
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress
from drapeline.schema import Table

STILL, MEAN = "skinned_static", "skinned_mean"


def static_baseline_summary(
    truth: Truth, garments: StaticRows, splits: Sequence[str], *, components: int, seed: int
) -> Table:
    """Metrics of the baselines, fitted to the training split, and of the ground truth itself.

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
            found.append(
                summarise(
                    measured_at_rest(garments, rows, measures),
                    model="truth" if name == "registered" else "baseline",
                    variant=name,
                    split=split,
                    seed=seed,
                    stream=(name, split),
                    by_source=False,
                )
            )
    return join(found)


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
) -> Table:
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
                measured[name] += measured_in_motion(moving, rows)
            inside = measure_inside(moving, frames, moving.points(frames), body, topology)
            measured["moving"] += measured_in_motion(moving, inside)
        for name, every in measured.items():
            model = "truth" if name == "moving" else "baseline"
            how = {"model": model, "variant": name, "split": split, "seed": seed}
            found.append(summarise(every, **how, stream=(name, split)))
    return join(found)
