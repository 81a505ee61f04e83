"""Occlusion images: which parts of the body a garment covers (SMPLicit 3.2)."""

from dataclasses import dataclass

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.geometry.mesh import Mesh, face_normals, vertex_normals
from drapeline.geometry.rays import rays_hit

# Cloth that is further from the skin covers it no longer; wide skirts are 30 cm from the legs.
REACH_M = 0.4
_INSIDE_M = 0.01  # garments may touch the skin or cut into it


def covered_vertices(body: np.ndarray, faces: np.ndarray, garment: Mesh) -> np.ndarray:
    """(V,) bool: whether the ray from a vertex (V, 3) along its normal meets the garment.

    Unlike the nearest vertex, a ray tells skin below a hem from skin behind the cloth.
    """
    normals = vertex_normals(body, faces)
    starts = body - _INSIDE_M * normals
    reach = REACH_M + _INSIDE_M
    return rays_hit(starts, normals, garment.vertices, garment.faces, reach_m=reach)


@dataclass(frozen=True)
class TexturePixels:
    """Places of the body that the pixels of a square image in its texture coordinates show."""

    corners: np.ndarray  # (R * R, 3) vertices of the pixel's face; zeros where there is none
    weights: np.ndarray  # (R * R, 3) barycentric; zeros where there is none

    @property
    def resolution(self) -> int:
        """R."""
        return round(len(self.corners) ** 0.5)

    def image(self, covered: np.ndarray) -> np.ndarray:
        """(R, R) bool of values (V,) bool at the vertices: where most of a pixel's face has it."""
        value = (self.weights * covered[self.corners]).sum(axis=1)
        return (value > 0.5).reshape(self.resolution, self.resolution)


def texture_pixels(body: BodyModel, resolution: int) -> TexturePixels:
    """Rasterise a body's texture coordinates at the centres of R x R pixels.

    A body without texture coordinates is seen from the front and from the back, side by side.
    Bodies of an experiment share their faces, so that either gender's will do.
    """
    uv = _front_and_back(body) if body.vt is None or body.ft is None else body.vt[body.ft]
    places = uv * resolution - 0.5  # (F, 3, 2) in pixels, whose centres are whole numbers
    corners = np.zeros((resolution * resolution, 3), dtype=np.int64)
    weights = np.zeros((resolution * resolution, 3))
    low = np.clip(np.ceil(places.min(axis=1)).astype(int), 0, resolution)
    high = np.clip(np.floor(places.max(axis=1)).astype(int) + 1, 0, resolution)
    for face in np.flatnonzero((high > low).all(axis=1)):
        (column, row), (last_column, last_row) = low[face], high[face]
        x, y = np.meshgrid(np.arange(column, last_column), np.arange(row, last_row))
        share = _barycentric(places[face], np.stack([x.ravel(), y.ravel()], axis=1))
        inside = (share >= 0).all(axis=1)
        # Rows of an image go down, the second texture coordinate goes up.
        pixel = ((resolution - 1 - y.ravel()) * resolution + x.ravel())[inside]
        corners[pixel], weights[pixel] = body.faces[face], share[inside]
    return TexturePixels(corners, weights)


def _front_and_back(body: BodyModel) -> np.ndarray:
    """(F, 3, 2) texture coordinates: faces that look ahead on the left, the others on the right."""
    low = body.v_template.min(axis=0)
    flat = ((body.v_template - low) / np.ptp(body.v_template, axis=0).max())[:, :2]
    uv = flat[body.faces] * [0.5, 1.0]
    uv[face_normals(body.v_template, body.faces)[:, 2] < 0, :, 0] += 0.5
    return uv


def _barycentric(triangle: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(P, 3) weights of points (P, 2) in a triangle (3, 2); negative if it has no area."""
    a, b = triangle[1] - triangle[0], triangle[2] - triangle[0]
    area = a[0] * b[1] - a[1] * b[0]
    if area == 0:
        return np.full((len(points), 3), -1.0)
    away = points - triangle[0]
    second = (away[:, 0] * b[1] - away[:, 1] * b[0]) / area
    third = (a[0] * away[:, 1] - a[1] * away[:, 0]) / area
    return np.stack([1 - second - third, second, third], axis=1)
