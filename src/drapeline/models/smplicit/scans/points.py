"""Points of a segmented scan that a garment's field is compared with (SMPLicit 4.2).

The field is zero at points of the garment. Around them it is the distance from the garment's
points, and so it is above skin and cloth that the garment would cover, which would otherwise not be
seen. P points, V vertices of the body.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.errors import InputError

_NEIGHBOURS = 9  # of a scan's point that its tangent plane goes through, itself among them
_BESIDE_M = 0.15  # within which most of what bounds a garment is
_ABOVE_M = 0.25  # from skin, within which a garment may cover it
_LEAST = 50  # points of a garment


class FieldPoints(NamedTuple):
    """Points in the scan's world with distances that a garment's field has there."""

    places: np.ndarray  # (P, 3) metres
    distance_m: np.ndarray  # (P,) from the garment
    weight: np.ndarray  # (P,) how much each counts


def field_points(
    scan: SegmentedScan,
    garment: str,
    body: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    *,
    cloth: int,
    around: int,
    spread_m: float,
    uncovered_weight: float,
) -> FieldPoints:
    """Points that a garment's field is compared with.

    Args:
        body: vertices (V, 3) of the body in the scan, and their outward normals.
        cloth: number of points on the garment.
        around: number of points off it: a third next to it in space, the others where the scan
            shows skin or cloth that the garment would cover, up to 25 cm above it but mostly less,
            half of them close to the garment.
        spread_m: standard deviation of the distance of those in space.
        uncovered_weight: of a point where the scan shows what the garment would cover; of others 1.

    Raises:
        InputError: fewer than 50 points are the garment's.
    """
    own, beside = scan.points_of(garment), scan.points_beside(garment)
    if len(own) < _LEAST:
        raise InputError(
            f"{scan.name}: {len(own)} points are labelled as {garment}, expected at least {_LEAST}"
        )
    third = around // 3
    near = own[rng.integers(len(own), size=third)]
    parts = [near + rng.normal(scale=spread_m, size=near.shape)]
    if len(beside):
        close = beside[KDTree(own).query(beside)[0] < _BESIDE_M]
        below = np.concatenate([_some(some, third, rng) for some in (close, beside)])
        outward = body[1][KDTree(body[0]).query(below)[1]]
        parts.append(below + _ABOVE_M * rng.random((len(below), 1)) ** 2 * outward)
    off = np.concatenate(parts)
    on_it = _some(own, cloth, rng)
    distance = np.concatenate([np.zeros(len(on_it)), cloud_distances(off, own)])
    weight = np.ones(len(distance))
    weight[len(on_it) + len(near) :] = uncovered_weight
    return FieldPoints(np.concatenate([on_it, off]).astype(np.float64), distance, weight)


def _some(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return points[rng.choice(len(points), min(len(points), count), replace=False)]


def cloud_distances(points: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """(P,) distances of points from the surface that a cloud (n, 3) was taken of.

    Between its points a cloud is continued by the tangent plane of the nearest one, as far as its
    neighbours are away.
    """
    tree = KDTree(cloud)
    distance, nearest = tree.query(points)
    used, place = np.unique(nearest, return_inverse=True)
    around, ids = tree.query(cloud[used], k=min(_NEIGHBOURS, len(cloud)))
    patch = cloud[ids] - cloud[ids].mean(axis=1, keepdims=True)
    # The normal is the direction of least spread.
    normal = np.linalg.eigh(np.einsum("nki,nkj->nij", patch, patch))[1][..., 0]
    away = points - cloud[nearest]
    height = np.abs(np.einsum("pi,pi->p", away, normal[place]))
    across = np.sqrt(np.maximum(distance**2 - height**2, 0))
    beyond = np.maximum(across - around[place, -1], 0)
    return np.hypot(height, beyond)
