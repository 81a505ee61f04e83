"""Open surfaces with exact distances, to find again from these."""

from collections.abc import Callable

import numpy as np


class AnalyticField:
    """A distance field from a formula; counts the points it is asked about.

    Args:
        exact: distances (P,) at points (P, 3) float64.
        error_m: what the field adds to them, before it is clipped.
    """

    def __init__(self, exact: Callable, *, clip_m: float = 0.03, error_m: float = 0.0) -> None:
        self.exact, self.clip_m, self._error_m = exact, clip_m, error_m
        self.asked = self.asked_gradients = 0

    def distances(self, points: np.ndarray) -> np.ndarray:
        assert points.dtype == np.float32
        self.asked += len(points)
        return self._value(points.astype(np.float64)).astype(np.float32)

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.asked_gradients += len(points)
        points, step = points.astype(np.float64), 1e-6
        slopes = [
            (self._value(points + move) - self._value(points - move)) / (2 * step)
            for move in step * np.eye(3)
        ]
        return self._value(points), np.stack(slopes, axis=1)

    def _value(self, points: np.ndarray) -> np.ndarray:
        return np.minimum(self.exact(points) + self._error_m, self.clip_m)


def open_tube(points: np.ndarray) -> np.ndarray:
    """Distance to a skirt: a tube of radius 0.12 m around z, from z = -0.15 to 0.15."""
    around = np.linalg.norm(points[:, :2], axis=1) - 0.12
    return np.hypot(around, np.maximum(np.abs(points[:, 2]) - 0.15, 0))


def half_sphere(points: np.ndarray) -> np.ndarray:
    """Distance to the half with z >= 0 of a sphere of radius 0.1 m."""
    x, y, z = points.T
    ring = np.hypot(np.hypot(x, y) - 0.1, z)
    return np.where(z >= 0, np.abs(np.linalg.norm(points, axis=1) - 0.1), ring)


def four_openings(points: np.ndarray) -> np.ndarray:
    """Distance to a t-shirt: a tube of radius 0.1 m around z, and one of 0.06 m around x.

    They end at z = -0.2 and 0.2 and at x = -0.25 and 0.25. Exact but near where they meet.
    """
    x, y, z = points.T
    around = np.minimum(np.hypot(x, y) - 0.1, np.hypot(y, z) - 0.06)
    beyond = np.maximum(np.abs(z) - 0.2, np.abs(x) - 0.25)
    return np.hypot(around, np.maximum(beyond, 0))
