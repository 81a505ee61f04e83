"""Clouds and bodies that are worse than simulated ones, as scans of real people are.

F frames, P points of a cloud.
"""

import numpy as np

from drapeline.dataset.point_clouds import camera_ring, cut_holes, find_seen

# Clouds and bodies are worse by shares of these, which are drawn for each sequence: the standard
# deviation of points in metres, the share of points in holes and the number of cameras ...
_POINT_NOISE_M, _MISSING, _CAMERAS = 0.02, 0.8, (1, 2, 4)
# ... and standard deviations of pose parameters in rad, shape coefficients, and the position of the
# root joint in metres. It is what a fit to points without labels leaves of twice as much.
_POSE_NOISE_RAD, _SHAPE_NOISE, _ROOT_NOISE_M = 0.04, 0.4, 0.01


def worse_clouds(
    points: np.ndarray, labels: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A sequence's clouds (F, P, 3) and labels (F, P) with noise, and with holes or few cameras.

    A third of all sequences has neither holes nor few cameras.
    """
    noise_m = rng.random() * _POINT_NOISE_M
    kind, missing = rng.integers(3), rng.random() * _MISSING
    cameras = camera_ring(int(rng.choice(_CAMERAS)), rng.uniform(0, 2 * np.pi))
    clouds, kept = np.array(points, dtype=np.float32), np.array(labels)
    for frame, pair in enumerate(zip(points, labels, strict=True)):
        if kind == 1:
            clouds[frame], kept[frame] = cut_holes(*pair, missing, rng)
        elif kind == 2:
            seen = find_seen(cameras, pair[0], rng)
            clouds[frame], kept[frame] = (each[seen] for each in pair)
    clouds += rng.normal(0, noise_m, clouds.shape).astype(np.float32)
    return clouds, kept


def worse_body(
    shape: np.ndarray, poses: np.ndarray, points: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape (10,), poses (F, 72) and points relative to the root joint of a body that is off.

    It is off by the same in all frames.
    """
    share = rng.random()
    return (
        shape + rng.normal(0, share * _SHAPE_NOISE, len(shape)),
        poses + rng.normal(0, share * _POSE_NOISE_RAD, poses.shape[1]),
        points + rng.normal(0, share * _ROOT_NOISE_M, 3),
    )
