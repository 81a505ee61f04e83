"""Sequences whose inputs are worse than the simulated ones: what scans of real people are like.

F frames, P points of a cloud.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from drapeline.dataset.point_clouds import camera_ring, corrupt_labels, cut_holes, find_seen
from drapeline.frames import FPS
from drapeline.models.garment4d.data import BodySequences, Seen
from drapeline.models.garment4d.settings import EvaluationSettings
from drapeline.seeding import rng_for

UNDEGRADED = "undegraded"
_SHAPE_PER_RAD = 10.0  # noise on shape coefficients, per radian of that on poses


class Degraded(NamedTuple):
    """A sequence with one kind of input worse."""

    name: str
    seen: Seen
    step: int = 1  # from one of the sequence's frames that it has to the next


def degraded(
    sequences: BodySequences, sequence: int, settings: EvaluationSettings
) -> Iterator[Degraded]:
    """A sequence as it is, and with one kind of input worse.

    Names are `missing_30` (per cent of the points in holes), `accuracy_70` (per cent of the labels
    right, and given), `body_noise_50` (thousandths of a radian on every pose parameter, the same in
    all frames, and ten times as much on shape coefficients), `point_noise_10` (millimetres),
    `views_1` (cameras around the person) and `frame_rate_15` (frames per second).
    """
    data, seen = sequences.data, sequences.seen(sequence)
    name, labels = str(data.name[sequence]), data.labels[data.rows(sequence)]
    yield Degraded(UNDEGRADED, seen)
    for share in settings.missing:
        rng = rng_for(settings.seed, "missing", name, share)
        pairs = zip(seen.points, labels, strict=True)
        holed = np.stack([cut_holes(*frame, share, rng)[0] for frame in pairs])
        yield Degraded(f"missing_{round(100 * share)}", seen._replace(points=holed))
    for share in settings.accuracy:
        rng = rng_for(settings.seed, "accuracy", name, share)
        wrong = corrupt_labels(labels.ravel(), share, data.label, rng).reshape(labels.shape)
        yield Degraded(f"accuracy_{round(100 * share)}", seen._replace(labels=wrong))
    for noise_rad in settings.body_noise_rad:
        rng = rng_for(settings.seed, "noisy body", name)
        poses = seen.poses + noise_rad * rng.normal(size=72)
        shape = data.shape[sequence] + _SHAPE_PER_RAD * noise_rad * rng.normal(size=10)
        body = sequences.bodies.of(str(data.gender[sequence]), shape)
        yield Degraded(
            f"body_noise_{round(1000 * noise_rad)}", seen._replace(poses=poses, body=body)
        )
    for noise_m in settings.point_noise_m:
        rng = rng_for(settings.seed, "noisy points", name)
        noisy = (seen.points + rng.normal(0, noise_m, seen.points.shape)).astype(np.float32)
        yield Degraded(f"point_noise_{round(1000 * noise_m)}", seen._replace(points=noisy))
    for count in settings.views:
        rng = rng_for(settings.seed, "views", name)
        cameras = camera_ring(count, rng.uniform(0, 2 * np.pi))
        viewed = np.stack([cloud[find_seen(cameras, cloud, rng)] for cloud in seen.points])
        yield Degraded(f"views_{count}", seen._replace(points=viewed))
    for rate in settings.frame_rates:
        step = FPS // rate
        chosen = np.arange(0, len(seen.points), step)
        yield Degraded(f"frame_rate_{rate}", seen.frames(chosen), step)
