"""How much of a body in motion lies inside the body itself."""

from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.self_collision import part_of_joint
from drapeline.geometry.mesh import faces_within, vertex_normals
from drapeline.geometry.moving_surface import MovingSurface

_EVERY = 3  # frames between those that are measured
_HAIR_M = 1e-4  # so far outside its own place a vertex is looked for
_NEAR_M = 0.012
_STEEP = 0.7  # cosine: farther away, what is beneath the nearest one, not beside it, is in its part


class Overlap(NamedTuple):
    """What is left of self-collisions in a body's surface, over every third frame.

    A vertex is inside if the winding number of the surface is above 0 a tenth of a millimetre
    outside its own place. What the mean body has inside at rest, as in its mouth, does not count.
    """

    share: float  # mean share of the vertices that are inside
    # How deep the deepest of them is beneath the tangent plane of the nearest vertex of another
    # part of the body, metres; one beside it, as in a fold of its own part, does not count.
    depth_m: float


def measure_overlap(body: BodyModel, vertices: np.ndarray, collides: np.ndarray) -> Overlap:
    """Measure how a body overlaps itself.

    Args:
        vertices: (N, V, 3) metres, anywhere.
        collides: (V,) mask of the vertices that count; the surface ends where theirs does.
    """
    parts = part_of_joint()[body.segmentation]
    lifted, _ = _lift(body.v_template, body.faces)
    _, folded = MovingSurface(body.v_template, body.faces).locate(lifted)
    faces = faces_within(body.faces, collides)
    used = np.unique(faces)
    counted = used[~folded[used]]
    surface = MovingSurface(vertices[0], faces)
    count, depth_m = 0, 0.0
    measured = vertices[::_EVERY]
    for frame in measured:
        surface.move(frame)
        lifted, normals = _lift(frame, faces)
        _, inside = surface.locate(lifted[counted])
        count += int(inside.sum())
        depths = _depths(lifted, normals, parts, counted[inside], used)
        depth_m = max(depth_m, float(depths.max(initial=0)))
    return Overlap(count / max(len(measured) * len(counted), 1), depth_m)


def _lift(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) a hair outside their places, and their normals (V, 3)."""
    normals = vertex_normals(vertices.astype(np.float64), faces)
    return vertices + _HAIR_M * normals, normals


def _depths(
    points: np.ndarray, normals: np.ndarray, parts: np.ndarray, inside: np.ndarray, used: np.ndarray
) -> np.ndarray:
    """Depths (n,) in metres of points `inside` beneath those `used` of other parts."""
    squares = np.einsum("va,va->v", points, points)
    away = squares[inside, None] + squares[used] - 2 * points[inside] @ points[used].T
    away[parts[inside, None] == parts[used]] = np.inf
    nearest = used[away.argmin(axis=1)]
    way = points[nearest] - points[inside]
    distance = np.linalg.norm(way, axis=1)
    height = np.einsum("na,na->n", way, normals[nearest])
    beneath = (distance < _NEAR_M) | (height > _STEEP * distance)
    return np.where(beneath, np.maximum(height, 0), 0)
