"""Sequences whose inputs are worse than the simulated ones: what scans of real people are like.

F frames, P points of a cloud.
"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from drapeline.dataset.point_clouds import corrupt_labels, cut_holes
from drapeline.models.garment4d.data import BodySequences, Seen
from drapeline.models.garment4d.settings import EvaluationSettings
from drapeline.seeding import rng_for

UNDEGRADED = "undegraded"
_SHAPE_PER_RAD = 10.0  # noise on shape coefficients, per radian of that on poses
_CAMERA_M = 3.0  # distance of cameras from the root joint
_FLIP = 100.0  # radius of the sphere that points are flipped at, in distances of the farthest one


def degraded(
    sequences: BodySequences, sequence: int, settings: EvaluationSettings
) -> Iterator[tuple[str, Seen]]:
    """A sequence as it is, and with one kind of input worse, by name.

    Names are `missing_30` (per cent of the points in holes), `accuracy_70` (per cent of the labels
    right, and given), `body_noise_50` (thousandths of a radian on every pose parameter, the same in
    all frames, and ten times as much on shape coefficients), `point_noise_10` (millimetres) and
    `views_1` (cameras around the person).
    """
    data, seen = sequences.data, sequences.seen(sequence)
    name, labels = str(data.name[sequence]), data.labels[data.rows(sequence)]
    yield UNDEGRADED, seen
    for share in settings.missing:
        rng = rng_for(settings.seed, "missing", name, share)
        pairs = zip(seen.points, labels, strict=True)
        holed = np.stack([cut_holes(*frame, share, rng)[0] for frame in pairs])
        yield f"missing_{round(100 * share)}", seen._replace(points=holed)
    for share in settings.accuracy:
        rng = rng_for(settings.seed, "accuracy", name, share)
        wrong = corrupt_labels(labels.ravel(), share, data.label, rng).reshape(labels.shape)
        yield f"accuracy_{round(100 * share)}", seen._replace(labels=wrong)
    for noise_rad in settings.body_noise_rad:
        rng = rng_for(settings.seed, "noisy body", name)
        poses = seen.poses + noise_rad * rng.normal(size=72)
        shape = data.shape[sequence] + _SHAPE_PER_RAD * noise_rad * rng.normal(size=10)
        body = sequences.bodies.of(str(data.gender[sequence]), shape)
        yield f"body_noise_{round(1000 * noise_rad)}", seen._replace(poses=poses, body=body)
    for noise_m in settings.point_noise_m:
        rng = rng_for(settings.seed, "noisy points", name)
        noisy = (seen.points + rng.normal(0, noise_m, seen.points.shape)).astype(np.float32)
        yield f"point_noise_{round(1000 * noise_m)}", seen._replace(points=noisy)
    for count in settings.views:
        rng = rng_for(settings.seed, "views", name)
        angle = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
        cameras = _CAMERA_M * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        viewed = np.stack([seen_by(cameras, cloud, rng) for cloud in seen.points])
        yield f"views_{count}", seen._replace(points=viewed)


def seen_by(cameras: np.ndarray, cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P, 3) the points of a cloud that cameras see, repeated to as many.

    Points that are hidden behind others are found by flipping the cloud at a sphere around each
    camera: what is seen is on its convex hull (Katz, Tal and Basri, Direct Visibility of Point
    Sets, 2007).
    """
    found = []
    for camera in cameras:
        rays = cloud.astype(np.float64) - camera
        away = np.linalg.norm(rays, axis=1, keepdims=True)
        flipped = rays + 2 * (_FLIP * away.max() - away) * rays / away
        hull = ConvexHull(np.concatenate([flipped, np.zeros((1, 3))])).vertices
        found.append(hull[hull < len(cloud)])
    left = np.unique(np.concatenate(found))
    return cloud[rng.permutation(np.resize(rng.permutation(left), len(cloud)))]
