"""Fitting garments to a body: resizing, leaving the body, and laying one garment over another."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial import KDTree

from drapeline.geometry.signed_distance import SignedDistance

RESIZE_PASSES = 40  # Laplacian passes over the displacements at edges of ...
RESIZE_EDGE_M = 0.01  # ... this length; finer meshes take more for the same reach
_ANGLE_BINS = 72
_HEIGHT_BIN_M = 0.01


def resized(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    mean_body: np.ndarray,
    target_body: np.ndarray,
    passes: int,
) -> np.ndarray:
    """Garment (V, 3) moved as the body under it moves from one shape to another.

    Every vertex takes the displacement of the nearest body vertex; Laplacian smoothing of the
    displacements keeps the body's details off the cloth.
    """
    _, nearest = KDTree(mean_body).query(vertices, k=8)
    displacement = (target_body - mean_body)[nearest].mean(axis=1)
    for _ in range(passes):
        displacement = (displacement + average @ displacement) / 2
    return vertices + displacement


def left_body(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    body: SignedDistance,
    gap_m: float,
    keep: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Garment (V, 3) with every vertex at least `gap_m` outside the body.

    Pushes are spread over the neighbourhood so that the body does not emboss the cloth.

    Args:
        keep: applied last in every round; keeps apart what lies side by side, and wins over the
            gap where a body leaves no room, as between thighs that touch.
    """
    points = vertices.copy()
    for round_ in range(8):
        distance, out = body.outside(points)
        lack = np.maximum(gap_m - distance, 0)
        if lack.max() <= 1e-6:
            break
        push = lack[:, None] * out * 1.02
        if round_ < 5:
            spread = push
            for _ in range(6):
                mean = average @ spread
                longer = (mean * mean).sum(1) > (spread * spread).sum(1)
                spread = np.where(longer[:, None], mean, spread)
            push = spread
        points += push
        if keep is not None:
            points = keep(points)
    return points


def laid_over(
    outer: np.ndarray, average: sp.csr_matrix, inner: np.ndarray, axis_y: float, gap_m: float
) -> np.ndarray:
    """Outer garment's vertices moved away from the body's axis until they clear the inner one.

    Args:
        outer, inner: (V, 3) vertices; the inner garment's outline is taken per height and angle.
        axis_y: where the vertical axis stands.
    """
    base = min(inner[:, 2].min(), outer[:, 2].min())
    rows = int((inner[:, 2].max() - base) / _HEIGHT_BIN_M) + 2

    def bins(points: np.ndarray):
        angle = np.arctan2(points[:, 0], points[:, 1] - axis_y) % (2 * np.pi)
        radius = np.hypot(points[:, 0], points[:, 1] - axis_y)
        return (points[:, 2] - base) / _HEIGHT_BIN_M, angle / (2 * np.pi) * _ANGLE_BINS, radius

    height, angle, radius = bins(inner)
    outline = np.zeros((rows, _ANGLE_BINS))
    np.maximum.at(
        outline, (np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS), radius
    )
    outline = maximum_filter(outline, size=(5, 3), mode=("nearest", "wrap"))
    outline = gaussian_filter(outline, 1.0, mode=("nearest", "wrap"))
    height, angle, radius = bins(outer)
    row, column = np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS
    under = row < rows
    need = np.zeros(len(outer))
    need[under] = outline[row[under], column[under]]
    push = np.where(need > 0, np.maximum(need + gap_m - radius, 0), 0)
    for _ in range(10):
        push = np.maximum(push, average @ push)
    spoke = (outer[:, :2] - [0, axis_y]) / np.maximum(radius, 1e-9)[:, None]
    moved = outer.copy()
    moved[:, :2] += push[:, None] * spoke
    return moved
