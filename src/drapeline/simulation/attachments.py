"""Holds of garments: waistbands that follow the body, elastics that gather an end."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.geometry.mesh import edges
from drapeline.geometry.rotations import nearest_rotations
from drapeline.simulation.collider import MovingBody

_PATCH = 64  # body vertices that carry one vertex of a waistband
_MOST_GATHERED = 0.45


class Carrier:
    """Moves points with a body; built once, called per frame."""

    def __init__(self, points: np.ndarray, body: np.ndarray) -> None:
        """Tie points (P, 3) to the nearest vertices of a body (V, 3)."""
        _, near = KDTree(body).query(points, k=min(_PATCH, len(body)))
        patch = body[near].astype(np.float64)
        centre = patch.mean(axis=1, keepdims=True)
        self._arm = points[:, None] - centre
        # What sums over a body give of each patch: its shape now against its shape at first, in
        # three rows, and its mean.
        size = near.shape[1]
        shape = (patch - centre).transpose(0, 2, 1)
        rows = np.concatenate([shape, np.full((len(near), 1, size), 1 / size)], axis=1)
        columns = np.repeat(near, 4, axis=0)
        starts = np.arange(0, rows.size + 1, size)
        self._sums = sp.csr_matrix(
            (rows.ravel(), columns.ravel(), starts), shape=(4 * len(near), len(body))
        )

    def __call__(self, body: np.ndarray) -> np.ndarray:
        """Places of the points (P, 3) when the body is at `body` (V, 3)."""
        sums = (self._sums @ body.astype(np.float64)).reshape(-1, 4, 3)
        return (self._arm @ nearest_rotations(sums[:, :3]))[:, 0] + sums[:, 3]


class Pins:
    """Vertices (P,) of a garment that are held where the body carries them, as at a waistband.

    How firmly each is held is its weight (P,), 0-1.
    """

    def __init__(self, weights: np.ndarray, garment: np.ndarray, body: MovingBody) -> None:
        """Hold the vertices of a garment (V, 3) in frame 0 whose weight (V,) is not zero."""
        self.vertices = np.flatnonzero(weights)
        self.weights = weights[self.vertices]
        self._body = body
        self._carrier = (
            Carrier(garment[self.vertices].astype(np.float64), body.frame(0))
            if len(self.vertices)
            else None
        )

    def positions(self, frame: int) -> np.ndarray:
        """Places that they are held at in a frame, world (P, 3) metres."""
        if self._carrier is None:
            return np.zeros((0, 3))
        return self._carrier(self._body.frame(frame))


def elastic_shrinkage(
    vertices: np.ndarray, faces: np.ndarray, elastic: np.ndarray, body: np.ndarray, *, gap_m: float
) -> np.ndarray:
    """Share (V,) by which rest lengths shrink so that elastic bands lie on the body.

    Each connected band shrinks as a whole: by its mean distance from the body, less the gap,
    over its radius.

    Args:
        elastic: (V,) 0-1, how much of an elastic a vertex has.
        body: (B, 3) body vertices in the garment's frame and pose.
    """
    share = np.zeros(len(vertices))
    inside = elastic > 0
    if not inside.any():
        return share
    pairs = edges(faces)
    pairs = pairs[inside[pairs].all(axis=1)]
    graph = sp.coo_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2
    )
    _, band = connected_components(graph, directed=False)
    distance, _ = KDTree(body).query(vertices[inside])
    away = np.zeros(len(vertices))
    away[inside] = distance
    for label in np.unique(band[inside]):
        member = np.flatnonzero(inside & (band == label))
        points = vertices[member]
        radius = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
        wanted = (away[member].mean() - gap_m) / max(radius, 1e-6)
        share[member] = elastic[member] * float(np.clip(wanted + 0.05, 0.05, _MOST_GATHERED))
    return share
