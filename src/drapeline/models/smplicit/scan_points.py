"""Points of a segmented scan that a garment's field is compared with (SMPLicit 4.2).

The field is zero at points of the garment. Around them, and where the scan shows something else, it
is the distance from the garment's points. P points.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.errors import InputError

_NEIGHBOURS = 9  # of a scan's point that its tangent plane goes through, itself among them
_BESIDE_M = 0.15  # within which most of what bounds a garment is
_LEAST = 50  # points of a garment


class FieldPoints(NamedTuple):
    """Points in the scan's world with distances that a garment's field has there.

    Attributes:
        places: (P, 3) metres.
        distance_m: (P,) from the garment.
    """

    places: np.ndarray
    distance_m: np.ndarray


def field_points(
    scan: SegmentedScan,
    garment: str,
    rng: np.random.Generator,
    *,
    on: int,
    off: int,
    spread_m: float,
) -> FieldPoints:
    """Points that a garment's field is compared with.

    Args:
        scan: that shows the garment.
        garment: its type.
        rng: draws the points.
        on: number of points on the garment.
        off: number of points off it: a third next to it in space, the others where the scan shows
            skin or cloth that the garment would cover.
        spread_m: standard deviation of the distance of those in space.

    Raises:
        InputError: fewer than 50 points are the garment's.
    """
    own, beside = scan.points_of(garment), scan.points_beside(garment)
    if len(own) < _LEAST:
        raise InputError(
            f"{scan.name}: {len(own)} points are labelled as {garment}, expected at least {_LEAST}"
        )
    near = own[rng.integers(len(own), size=off // 3)]
    parts = [near + rng.normal(scale=spread_m, size=near.shape)]
    if len(beside):
        distance, _ = KDTree(own).query(beside)
        close = np.flatnonzero(distance < _BESIDE_M)
        for chosen in (close, np.arange(len(beside))):
            parts.append(
                beside[chosen[: off // 3]]
                if len(chosen) <= off // 3
                else beside[rng.choice(chosen, off // 3, replace=False)]
            )
    around = np.concatenate(parts)
    on_it = own[rng.choice(len(own), min(on, len(own)), replace=False)]
    distance = np.concatenate([np.zeros(len(on_it)), cloud_distances(around, own)])
    return FieldPoints(np.concatenate([on_it, around]).astype(np.float64), distance)


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
