"""Smoothing over the edges of a mesh: neighbour averages, Laplacian smoothing, fairing."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import (
    boundary_edges,
    edge_graph,
    edge_lengths,
    edges,
    vertex_normals,
)

# Moves points (P, 3) to where they may be, such as out of a solid.
Constraint = Callable[[np.ndarray], np.ndarray]
_EQUALISING_STEP = 0.7
_SMALL_M2 = 1e-9
_COTANGENTS = (0.0, 10.0)  # of angles that count; others would make slivers all that counts
_RIM_M = 0.06  # within which a sheet's free edges hold it more and more


def averaging_matrix(
    faces: np.ndarray, count: int, *, along_boundaries: bool = False
) -> sp.csr_matrix:
    """Matrix (count, count) that gives each vertex the mean of its edge neighbours.

    Rows of vertices without edges are zero.

    Args:
        faces: (F, 3) or (F, 4).
        count: number of vertices.
        along_boundaries: whether a vertex on a boundary averages its neighbours along the
            boundary alone, so that smoothing leaves hems as lines.
    """
    graph = edge_graph(edges(faces), count)
    if along_boundaries:
        boundary = edge_graph(boundary_edges(faces), count)
        inside = _degrees(boundary) == 0
        graph = sp.diags(inside.astype(float)) @ graph + boundary
    return (sp.diags(1 / np.maximum(_degrees(graph), 1)) @ graph).tocsr()


def uniform_laplacian(faces: np.ndarray, count: int) -> sp.csr_matrix:
    """Matrix (count, count) of degrees less adjacency: the graph Laplacian of a mesh's edges."""
    graph = edge_graph(edges(faces), count)
    return sp.diags(_degrees(graph)) - graph


def _degrees(graph: sp.csr_matrix) -> np.ndarray:
    """(V,) number of neighbours."""
    return np.asarray(graph.sum(axis=1)).ravel()


def blur(values: np.ndarray, average: sp.csr_matrix, passes: int) -> np.ndarray:
    """Move values (V, ...) half-way to their neighbours' mean, `passes` times.

    `average` is of `averaging_matrix`.
    """
    for _ in range(passes):
        values = (values + average @ values) / 2
    return values


def spread_pushes(pushes: np.ndarray, average: sp.csr_matrix, passes: int) -> np.ndarray:
    """Let pushes (V, 3) reach the neighbourhood: none gets shorter, short ones become the mean.

    `average` is of `averaging_matrix`.
    """
    for _ in range(passes):
        mean = average @ pushes
        longer = (mean * mean).sum(1) > (pushes * pushes).sum(1)
        pushes = np.where(longer[:, None], mean, pushes)
    return pushes


def smooth(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    weight: np.ndarray,
    passes: int,
    keep_out: Constraint | None = None,
) -> np.ndarray:
    """Laplacian smoothing with parts of a mesh held in place.

    Args:
        vertices: (V, 3).
        average: (V, V) of `averaging_matrix`.
        weight: (V,) share of the way to the neighbours' mean that a pass goes; 0 holds a vertex.
        keep_out: applied after each pass to the vertices that move.
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


def equalise_edges(
    vertices: np.ndarray,
    faces: np.ndarray,
    free: np.ndarray,
    passes: int,
    keep_out: Constraint | None = None,
) -> np.ndarray:
    """Move free vertices so that their edges get similar lengths: longer edges pull harder.

    Unlike plain smoothing this does not crowd vertices where a border bends into the cloth.

    Args:
        vertices: (V, 3).
        faces: (F, 3) or (F, 4).
        free: (V,) bool, the vertices to move.
        keep_out: applied after each pass to the vertices that move.
    """
    pairs = edges(faces)
    pairs = pairs[free[pairs].any(axis=1)]
    out = vertices.copy()
    count = len(vertices)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    for _ in range(passes):
        pull = np.tile(edge_lengths(out, pairs), 2)
        total = np.bincount(ends[:, 0], pull, count)
        goal = np.stack(
            [np.bincount(ends[:, 0], pull * out[ends[:, 1], k], count) for k in range(3)], axis=1
        )
        out[free] += _EQUALISING_STEP * (goal[free] / total[free, None] - out[free])
        if keep_out is not None:
            out[free] = keep_out(out[free])
    return out


def fairing(faces: np.ndarray, count: int, strength: float) -> Callable[[np.ndarray], np.ndarray]:
    """A function that removes bumps from the vertices (count, 3) of one mesh.

    It minimises |x - given|^2 + strength |x - Mx|^2, where M is `averaging_matrix` along
    boundaries. Bumps a few edges wide are removed, wide folds stay, and unlike plain smoothing it
    does not shrink boundaries.

    Args:
        faces: (F, 3).
        count: number of vertices.
        strength: of the second term; folds n edges long lose half their height at 0.01 n^4.
    """
    away = sp.eye(count) - averaging_matrix(faces, count, along_boundaries=True)
    return symmetric_factor(sp.eye(count) + strength * away.T @ away).solve


def cotangent_laplacian(
    points: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, sp.csr_matrix]:
    """Areas (V,) of vertices, and the cotangent Laplacian (V, V), positive semidefinite.

    Args:
        points: (V, 3) metres.
        triangles: (F, 3), which may be slivers.
    """
    count, corners = len(points), np.asarray(points, dtype=np.float64)[triangles]
    graph, area = sp.csr_matrix((count, count)), np.full(count, _SMALL_M2)
    for k in range(3):
        start, end = triangles[:, (k + 1) % 3], triangles[:, (k + 2) % 3]
        a, b = (corners[:, (k + side) % 3] - corners[:, k] for side in (1, 2))
        double = np.maximum(np.linalg.norm(np.cross(a, b), axis=1), _SMALL_M2)
        weight = np.clip(np.einsum("fi,fi->f", a, b) / double, *_COTANGENTS) / 2
        one = sp.coo_matrix((weight, (start, end)), (count, count))
        graph = graph + one + one.T
        area += np.bincount(triangles[:, k], double / 6, count)
    return area, (sp.diags(_degrees(graph)) - graph).tocsr()


def fill_dents(points: np.ndarray, triangles: np.ndarray, wave_m: float, passes: int) -> np.ndarray:
    """Raise what lies lower than its surroundings, as cloth spans what it is laid over.

    Each pass moves vertices towards the surface without waves shorter than `wave_m`, as far as that
    is outward: unlike smoothing, it makes no tube thinner. Free edges stay.

    Args:
        points: (V, 3) metres.
        triangles: (F, 3), outwards.
        wave_m: that loses half of its height in a surface without dents.
    """
    points = np.asarray(points, dtype=np.float64)
    rim = np.unique(boundary_edges(triangles))
    free = np.ones(len(points))
    if len(rim):
        free = np.minimum(KDTree(points[rim]).query(points)[0] / _RIM_M, 1)
    for _ in range(passes):
        area, stiffness = cotangent_laplacian(points, triangles)
        bending = stiffness @ sp.diags(1 / area) @ stiffness
        system = sp.diags(area) + (wave_m / (2 * np.pi)) ** 4 * bending
        away = symmetric_factor(system).solve(area[:, None] * points) - points
        outward = np.einsum("vi,vi->v", away, vertex_normals(points, triangles))
        share = outward / np.maximum(np.linalg.norm(away, axis=1), _SMALL_M2)
        points = points + (free * np.maximum(share, 0))[:, None] * away
    return points
