"""Simulated garments in motion: their ground truth, trivial predictions, and how good any are."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.errors import InputError
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.garment import garment_measures, garment_mesh, inside_measures
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import (
    dynamic_offsets,
    points_from_offsets,
)
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress
from drapeline.seeding import rng_for

CONTACT_EVERY = 5
STILL, MEAN = "skinned_static", "skinned_mean"


def measure_motion(
    moving: MovingGarment,
    frames: np.ndarray,
    predicted: np.ndarray,
    body: BodyModel,
    topology: Topology,
) -> list[dict[str, float]]:
    """Metrics of frames of one garment; what is inside the body only every fifth.

    Args:
        frames: (n,) to measure.
        predicted: (n, M, 3) registered points, root-relative metres.
        body: super-resolved, of the wearer's gender.
        topology: of the super-resolved bodies.
    """
    faces, mask = topology.faces_of(moving.name), moving.registered.mask
    found = []
    for index, (points, true) in enumerate(zip(predicted, moving.points(frames), strict=True)):
        vertices = moving.on_vertices(points)
        # The mask of a garment in motion is its static mask, which nothing predicts.
        measures = garment_measures(vertices, None, moving.on_vertices(true), mask, faces)
        if index % CONTACT_EVERY == 0:
            pose = moving.poses[frames[index]][None]
            posed = posed_vertices(body, moving.shape, pose)[0][0]
            worn = garment_mesh(vertices, faces, mask)
            measures |= inside_measures(worn.vertices, posed, topology.faces)
        found.append(measures)
    return found


class Measured(NamedTuple):
    """Metrics of the frames of one garment.

    Attributes:
        sample, garment: which one.
        rows: metric -> value, per frame.
    """

    sample: str
    garment: str
    rows: Sequence[Mapping[str, float]]


def moving_summary(
    measured: Sequence[Measured],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
) -> list[MetricRow]:
    """Rows of the table of metrics over all frames; samples are resampled as wholes."""
    return summary_rows(
        rng_for(seed, "intervals", variant, split),
        [row for one in measured for row in one.rows],
        [one.garment for one in measured for _ in one.rows],
        [one.sample for one in measured for _ in one.rows],
        model=model,
        variant=variant,
        split=split,
        seed=seed,
    )


def mean_wrinkles(
    garments: Iterable[MovingGarment], bodies: Mapping[str, BodyModel], step: int
) -> np.ndarray:
    """(types, V, 3) mean pose-invariant offsets of training garments, per type and vertex.

    Args:
        garments: looked at one after the other.
        bodies: super-resolved, by gender.
        step: of the frames looked at.

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
        kind = GARMENTS.index(moving.name)
        total[kind] += offsets.sum(axis=0)
        count[kind] += len(frames) * moving.registered.mask[:, None]
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
    """The static garment moved by its skinning weights, without and with the type's mean wrinkles.

    Args:
        training: garments that the mean is learned from.
        held_out: split -> garments to measure.
        bodies: super-resolved, by gender.
        step: of the frames measured, and of those that the mean is learned from.
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
                measured[name].append(Measured(moving.sample, moving.name, rows))
            rows = measure_motion(moving, frames, moving.points(frames), body, topology)
            inside = [{k: v for k, v in row.items() if k.startswith("inside")} for row in rows]
            measured["moving"].append(Measured(moving.sample, moving.name, inside))
        for name, rows in measured.items():
            model = "truth" if name == "moving" else "baseline"
            found += moving_summary(rows, model=model, variant=name, split=split, seed=seed)
    return found
