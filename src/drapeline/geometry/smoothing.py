"""Smoothing of garment meshes with parts held in place."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from drapeline.geometry.mesh import boundary_edges, edge_graph, edges
from drapeline.geometry.sparse import symmetric_factor


def averaging_matrix(faces: np.ndarray, count: int) -> sp.csr_matrix:
    """(count, count) matrix that replaces each vertex by the mean of its edge neighbours."""
    edge = edges(faces)
    both = np.concatenate([edge, edge[:, ::-1]])
    matrix = sp.csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(count, count))
    degree = np.maximum(np.asarray(matrix.sum(axis=1)).ravel(), 1)
    return sp.diags(1 / degree).dot(matrix).tocsr()


def smoothed(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    weight: np.ndarray,
    passes: int,
    keep_out: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Laplacian smoothing with a weight (V,) per vertex, 0 = held.

    Args:
        keep_out: applied to all positions after each pass, to leave a solid.
    """
    moved = weight > 0
    rows = average[moved]
    share = weight[moved, None]
    out = vertices.copy()
    for _ in range(passes):
        out[moved] += share * (rows @ out - out[moved])
        if keep_out is not None:
            out[moved] = keep_out(out[moved])
    return out


def evened(
    vertices: np.ndarray,
    faces: np.ndarray,
    free: np.ndarray,
    passes: int,
    keep_out: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Free vertices moved so that edges become alike: longer edges pull more.

    Unlike plain smoothing this does not crowd vertices where a border bends into the cloth.
    """
    pairs = edges(faces)
    pairs = pairs[free[pairs].any(axis=1)]
    out = vertices.copy()
    count = len(vertices)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    for _ in range(passes):
        pull = np.linalg.norm(out[pairs[:, 0]] - out[pairs[:, 1]], axis=1)
        pull = np.tile(pull, 2)
        total = np.bincount(ends[:, 0], pull, count)
        goal = np.stack(
            [np.bincount(ends[:, 0], pull * out[ends[:, 1], k], count) for k in range(3)], axis=1
        )
        out[free] += 0.7 * (goal[free] / total[free, None] - out[free])
        if keep_out is not None:
            out[free] = keep_out(out[free])
    return out


def fairing(
    faces: np.ndarray, average: sp.csr_matrix, strength: float
) -> Callable[[np.ndarray], np.ndarray]:
    """A function that evens out vertices (V, 3) of one mesh.

    It minimises |x - given|^2 + strength |x - Mx|^2, where M takes the mean of a vertex's
    neighbours; for a vertex on a boundary, of its neighbours along the boundary. Bumps a few edges
    wide are removed, wide folds stay, and unlike plain smoothing it does not shrink boundaries.

    Args:
        faces: (F, 3).
        average: (V, V), see `averaging_matrix`.
        strength: of the second term; folds as long as n edges lose half at 0.01 n^4.
    """
    count = average.shape[0]
    boundary = edge_graph(boundary_edges(faces), count)
    on_boundary = np.asarray(boundary.sum(axis=1)).ravel()
    inner = sp.diags((on_boundary == 0).astype(float)) @ average
    away = sp.eye(count) - inner - sp.diags(1 / np.maximum(on_boundary, 1)) @ boundary
    return symmetric_factor(sp.eye(count) + strength * away.T @ away).solve
