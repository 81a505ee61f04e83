"""Points of space around a dressed body, and what a picture says about each (SMPLicit 4.3).

Points are drawn around the body at rest and follow it into its pose. Those that the posed body
does not hide fall on pixels: of the garment, where some point along the pixel's ray lies on it, or
of something else, where none does. None of this depends on the garment's code, so it is found once.

P points, V vertices of the body.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from drapeline.bodies.follow import PosedBody, follow, move
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import face_normals
from drapeline.geometry.rays import rays_hit
from drapeline.rendering.camera import Camera

_SKIN_M = 2e-3  # rays towards the camera start this far off, so that the skin hides none of its own
_FAR_M = 1e4


def space_points(
    rng: np.random.Generator,
    body: PosedBody,
    box: tuple[np.ndarray, np.ndarray],
    *,
    count: int,
    reach_m: float,
) -> np.ndarray:
    """(P, 3) float32 points outside the body at rest, within a box and within reach of the skin.

    Args:
        rng: draws the points.
        body: at rest.
        box: lowest and highest corner, metres.
        count: of points drawn; those inside the body or beyond reach are dropped.
        reach_m: greatest distance from the body.
    """
    low = np.maximum(box[0], body.rest.min(axis=0) - reach_m)
    high = np.minimum(box[1], body.rest.max(axis=0) + reach_m)
    points = rng.uniform(low, high, (count, 3)).astype(np.float32)
    place, face = closest_points(points, body.rest, body.faces)
    away = points - place
    outside = np.einsum("pi,pi->p", away, face_normals(body.rest, body.faces[face])) > 0
    return points[outside & (np.linalg.norm(away, axis=1) < reach_m)]


def hidden_by_body(points: np.ndarray, body: PosedBody, camera: Camera) -> np.ndarray:
    """(P,) whether the posed body is between points (P, 3) of the world and the camera."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    way = camera.position - points
    length = np.linalg.norm(way, axis=1, keepdims=True)
    way /= length
    return rays_hit(
        points + _SKIN_M * way, way, body.posed, body.faces, reach_m=min(_FAR_M, length.max())
    )


@dataclass(frozen=True)
class RayPoints:
    """Points by the rays that they are on; a ray is a small square of pixels.

    Attributes:
        points: (P, 3) float32 at rest, ray by ray.
        first: (R + 1,) the first point of each ray, and P.
        clearance_m: (P,) float32, distance of the points' pixels from the nearest one of the
            garment, at the depth of the points: what is seen of the garment is no closer to them.
    """

    points: np.ndarray
    first: np.ndarray
    clearance_m: np.ndarray

    def __len__(self) -> int:
        return len(self.first) - 1

    def members(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, M) indices of the points of some rays, the first repeated; which are no repeats."""
        count = np.diff(self.first)[rays]
        column = np.arange(count.max(initial=1))
        own = column < count[:, None]
        return self.first[rays][:, None] + np.where(own, column, 0), own


class SeenPoints(NamedTuple):
    """Points that a picture tells something about, all of them in sight.

    Attributes:
        on: whose pixels show the garment.
        off: whose pixels show something else.
    """

    on: RayPoints
    off: RayPoints


def seen_points(
    points: np.ndarray,
    body: PosedBody,
    camera: Camera,
    garment: np.ndarray,
    unknown: np.ndarray,
    *,
    neighbours: int,
    ray_m: float,
) -> SeenPoints:
    """What a picture tells about points of the space around a body.

    Args:
        points: (P, 3) at rest, outside the body.
        body: at rest and posed.
        camera: of the picture.
        garment: (H, W) bool, where the garment is seen.
        unknown: (H, W) bool, pixels that tell nothing about it.
        neighbours: see `follow`.
        ray_m: side of the squares of pixels that count as one ray, on the body.
    """
    posed = move(points, follow(points, body, neighbours))
    image, depth = camera.project(posed)
    pixel = np.floor(image).astype(np.int64)
    size = np.array([camera.width, camera.height])
    kept = (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < size).all(axis=1)
    kept[kept] = ~unknown[pixel[kept, 1], pixel[kept, 0]]
    kept[kept] = ~hidden_by_body(posed[kept], body, camera)
    points, pixel, depth = points[kept], pixel[kept], depth[kept]
    focal = camera.intrinsics[0, 0]
    side = max(1, round(ray_m * focal / float(np.median(depth)))) if len(depth) else 1
    column, row = pixel.T // side
    away_px = distance_transform_edt(~garment)[pixel[:, 1], pixel[:, 0]]
    clearance = (away_px * depth / focal).astype(np.float32)
    is_on = garment[pixel[:, 1], pixel[:, 0]]
    return SeenPoints(
        *(
            _by_rays(points[part], (row * camera.width + column)[part], clearance[part])
            for part in (is_on, ~is_on)
        )
    )


def _by_rays(points: np.ndarray, square: np.ndarray, clearance: np.ndarray) -> RayPoints:
    order = np.argsort(square, kind="stable")
    first = np.flatnonzero(np.diff(square[order], prepend=-1))
    return RayPoints(points[order], np.append(first, len(order)), clearance[order])
