"""Fitting garments to a body: resizing, leaving the body, and laying one garment over another."""

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial import KDTree

from drapeline.geometry.signed_distance import SignedDistance
from drapeline.geometry.smoothing import Constraint, blur, spread_pushes

RESIZE_PASSES = 40  # Laplacian passes over the displacements at edges of ...
RESIZE_EDGE_M = 0.01  # ... this length; finer meshes take more for the same reach
_ANGLE_BINS = 72
_HEIGHT_BIN_M = 0.01
_NEAREST = 8
_ROUNDS, _SPREAD_ROUNDS, _SPREAD_PASSES = 8, 5, 6
_OVERSHOOT = 1.02  # of a push, so that it arrives within the rounds
_OVER_PASSES = 10


def resize(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    mean_body: np.ndarray,
    target_body: np.ndarray,
    passes: int,
) -> np.ndarray:
    """Move a garment as the body under it moves from one shape to another.

    Every vertex takes the mean displacement of the nearest body vertices; smoothing the
    displacements keeps the body's details off the cloth.

    Args:
        vertices: (V, 3) garment on `mean_body`, metres.
        average: (V, V) of `averaging_matrix`.
        mean_body, target_body: (B, 3) body before and after.
        passes: of smoothing.

    Returns:
        (V, 3) metres.
    """
    _, nearest = KDTree(mean_body).query(vertices, k=_NEAREST)
    displacement = (target_body - mean_body)[nearest].mean(axis=1)
    return vertices + blur(displacement, average, passes)


def leave_body(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    body: SignedDistance,
    gap_m: float,
    separate: Constraint | None = None,
) -> np.ndarray:
    """Push a garment out of the body until every vertex is at least `gap_m` outside.

    Pushes are spread over the neighbourhood so that the body does not emboss the cloth.

    Args:
        vertices: (V, 3) metres.
        average: (V, V) of `averaging_matrix`.
        body: signed distances to it.
        gap_m: between body and cloth.
        separate: applied last in every round, see `separator`; it wins over the gap where a body
            leaves no room, as between thighs that touch.

    Returns:
        (V, 3) metres.
    """
    points = vertices.copy()
    for round_ in range(_ROUNDS):
        distance, out = body.query(points)
        lack = np.maximum(gap_m - distance, 0)
        if lack.max() <= 1e-6:
            break
        push = lack[:, None] * out * _OVERSHOOT
        if round_ < _SPREAD_ROUNDS:
            push = spread_pushes(push, average, _SPREAD_PASSES)
        points += push
        if separate is not None:
            points = separate(points)
    return points


def lay_over(
    outer: np.ndarray, average: sp.csr_matrix, inner: np.ndarray, axis_y: float, gap_m: float
) -> np.ndarray:
    """Move the outer garment away from the body's axis until it clears the inner one.

    Args:
        outer, inner: (V, 3) and (W, 3) vertices, metres; of the inner garment only the outline
            by height and angle counts.
        average: (V, V) of `averaging_matrix`, of the outer garment.
        axis_y: where the vertical axis stands.
        gap_m: between the garments.

    Returns:
        (V, 3) metres.
    """
    base = min(inner[:, 2].min(), outer[:, 2].min())
    rows = int((inner[:, 2].max() - base) / _HEIGHT_BIN_M) + 2

    def cylindrical(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and angle in bins, and radius in metres."""
        angle = np.arctan2(points[:, 0], points[:, 1] - axis_y) % (2 * np.pi)
        radius = np.hypot(points[:, 0], points[:, 1] - axis_y)
        return (points[:, 2] - base) / _HEIGHT_BIN_M, angle / (2 * np.pi) * _ANGLE_BINS, radius

    height, angle, radius = cylindrical(inner)
    outline = np.zeros((rows, _ANGLE_BINS))
    np.maximum.at(
        outline, (np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS), radius
    )
    outline = maximum_filter(outline, size=(5, 3), mode=("nearest", "wrap"))
    outline = gaussian_filter(outline, 1.0, mode=("nearest", "wrap"))
    height, angle, radius = cylindrical(outer)
    row, column = np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS
    beside = row < rows
    need = np.zeros(len(outer))
    need[beside] = outline[row[beside], column[beside]]
    push = np.where(need > 0, np.maximum(need + gap_m - radius, 0), 0)
    for _ in range(_OVER_PASSES):
        push = np.maximum(push, average @ push)
    spoke = (outer[:, :2] - [0, axis_y]) / np.maximum(radius, 1e-9)[:, None]
    moved = outer.copy()
    moved[:, :2] += push[:, None] * spoke
    return moved
