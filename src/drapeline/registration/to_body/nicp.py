"""Non-rigid ICP after Amberg, Romdhani and Vetter (2007): a garment is laid onto a body.

As in the paper, every part of the garment has an affine motion, neighbouring motions are kept
alike by a stiffness that is lowered step by step, and for each stiffness closest points and the
optimal motions take turns. Two things make it fast: the motions belong to some two hundred nodes
on the garment instead of to its thousands of vertices, and a last step lets the vertices
themselves follow, by translations only.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import (
    boundary_edges,
    edge_graph,
    edge_lengths,
    edges,
    vertex_normals,
)
from drapeline.geometry.smoothing import averaging_matrix, blur, uniform_laplacian

_PLANE_M = 0.01  # a tangent plane stands for the surface this far around its vertex


@dataclass(frozen=True)
class NicpSettings:
    """Settings of the fit of a garment to a body."""

    # Of the nodes, falling; for each there is one step of closest points and of motions towards
    # them.
    stiffness: tuple[float, ...] = (10.0, 3.0, 1.0, 0.3, 0.1)
    nodes: int = 200
    samples: int = 1500  # largest number of garment vertices that look for their closest points
    # Distance that a turn of the normal by one radian counts for: it keeps a sleeve off the torso
    # and one leg off the other.
    turn_m: float = 0.1
    bend_m: float = 0.1  # distance at which two unlike affine motions are compared
    smoothing_m: float = 0.05  # normals of the garment are averaged about this far, over its folds
    fine_rounds: int = 3  # turns of the last step
    fine_stiffness: float = 3.0  # of the vertices in the last step


class TargetSurface:
    """A body to lie on: closest points that face the same way.

    Args:
        vertices: (T, 3) metres, kept as an attribute in float64.
        faces: (F, 3), kept as an attribute.
        turn_m: see `NicpSettings`.

    Attributes:
        normals: (T, 3).
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, turn_m: float) -> None:
        self.vertices = np.asarray(vertices, dtype=np.float64)
        self.faces = faces
        self.normals = vertex_normals(self.vertices, faces)
        self._ids = np.unique(faces)
        self._turn_m = turn_m
        self._tree = KDTree(np.hstack([self.vertices, turn_m * self.normals])[self._ids])
        self._open = np.zeros(len(vertices), dtype=bool)
        self._open[boundary_edges(faces)] = True

    def closest(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Partners of points (P, 3) with unit normals (P, 3).

        Returns:
            The points' projections (P, 3) on the tangent plane of the vertex that is closest in
            place and normal, and whether that vertex is within the surface (P,): what reaches
            beyond its open ends has no partner.
        """
        _, nearest = self._tree.query(np.hstack([points, self._turn_m * normals]))
        near = self._ids[nearest]
        normal = self.normals[near]
        gap = points - self.vertices[near]
        height = (gap * normal).sum(1, keepdims=True)
        along = gap - height * normal
        reach = np.linalg.norm(along, axis=1, keepdims=True)
        along *= np.minimum(1, _PLANE_M / np.maximum(reach, 1e-9))
        return self.vertices[near] + along, ~self._open[near]


def fit_to_surface(
    vertices: np.ndarray, triangles: np.ndarray, surface: TargetSurface, settings: NicpSettings
) -> np.ndarray:
    """(V, 3) float64 metres of a garment deformed so that it lies on the surface.

    Args:
        vertices: (V, 3) metres, in rigid alignment with the surface.
        triangles: (F, 3), connected but for scraps.
        surface: the body.
    """
    rest = np.asarray(vertices, dtype=np.float64)
    count = len(rest)
    pairs = edges(triangles)
    lengths = edge_lengths(rest, pairs)
    average = averaging_matrix(triangles, count)
    corner_of = sp.csr_matrix(
        (np.ones(triangles.size), (triangles.ravel(), np.arange(len(triangles)).repeat(3))),
        shape=(count, len(triangles)),
    )
    passes = max(1, round((settings.smoothing_m / lengths.mean()) ** 2 / 2))

    def outward(places: np.ndarray) -> np.ndarray:
        a, b, c = (places[triangles[:, i]] for i in range(3))
        normals = corner_of @ np.cross(b - a, c - a)
        normals = blur(normals, average, passes)
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)

    nodes = _Nodes(rest, pairs, lengths, settings)
    places = nodes.lay(rest, surface, outward)
    # Uniform Laplacian: where cloth is spread over a wide body, it is spread evenly.
    laplacian = uniform_laplacian(triangles, count)
    _, piece = connected_components(edge_graph(pairs, count), directed=False)
    for _ in range(settings.fine_rounds):
        goal, inside = surface.closest(places, outward(places))
        # A scrap of which nothing has a partner stays where it is.
        alone = np.bincount(piece, inside)[piece] == 0
        system = sp.diags((inside | alone).astype(float)) + settings.fine_stiffness * laplacian
        move = inside[:, None] * (goal - places)
        places = places + symmetric_factor(system).solve(move)
    return places


class _Nodes:
    """Affine motions on a garment, and the least-squares problem of Amberg's equation 9."""

    def __init__(
        self, rest: np.ndarray, pairs: np.ndarray, lengths: np.ndarray, settings: NicpSettings
    ) -> None:
        self._settings = settings
        count = len(rest)
        self._chosen = _farthest_points(rest, settings.nodes)
        # Garments are numbered ring by ring, so that even steps are evenly spread.
        self._points = np.arange(0, count, max(1, -(-count // settings.samples)))
        cell = self._cells(count, pairs, lengths)
        self._weights = self._shares(rest, cell, pairs)
        self._smooth = self._stiffness(rest)
        self._base = self._design(rest, np.arange(count))
        self._data = self._base[self._points]

    def _cells(self, count: int, pairs: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """(V,) number of the node that is nearest to each vertex over the cloth."""
        graph = sp.coo_matrix((lengths, pairs.T), shape=(count, count)).tocsr()
        distance, _, source = dijkstra(
            graph, directed=False, indices=self._chosen, min_only=True, return_predecessors=True
        )
        lookup = np.zeros(count, dtype=np.int64)
        lookup[self._chosen] = np.arange(len(self._chosen))
        return lookup[np.where(np.isfinite(distance), source, self._chosen[0])]

    def _shares(self, rest: np.ndarray, cell: np.ndarray, pairs: np.ndarray) -> sp.csr_matrix:
        """(V, M) weights: a vertex follows the nodes of its own cell and of those around it."""
        count, m = len(rest), len(self._chosen)
        key = np.unique(np.sort(cell[pairs], axis=1) @ np.array([m, 1]))
        across = np.stack(np.divmod(key, m), axis=1)
        across = across[across[:, 0] != across[:, 1]]
        self._edges = across
        near = sp.coo_matrix((np.ones(len(across)), across.T), shape=(m, m)).tocsr()
        near = near + near.T + sp.identity(m)
        rows = sp.csr_matrix((np.ones(count), (np.arange(count), cell)), shape=(count, m)) @ near
        rows = rows.tocoo()
        gap = np.linalg.norm(rest[rows.row] - rest[self._chosen][rows.col], axis=1)
        # Nodes count less the further they are, and nothing at the reach of the cell's neighbours.
        reach = np.zeros(count)
        np.maximum.at(reach, rows.row, gap)
        value = np.maximum(1 - gap / (1.05 * reach[rows.row]), 0) ** 2 + 1e-9
        weights = sp.csr_matrix((value, (rows.row, rows.col)), shape=(count, m))
        return (sp.diags(1 / np.asarray(weights.sum(axis=1)).ravel()) @ weights).tocsr()

    def _design(self, rest: np.ndarray, rows: np.ndarray) -> sp.csr_matrix:
        """(P, 4 M): what the entries of the affine motions add to each vertex's place."""
        weights = self._weights[rows].tocoo()
        gap = rest[rows][weights.row] - rest[self._chosen][weights.col]
        values = weights.data[:, None] * np.column_stack([gap, np.ones(len(gap))])
        columns = 4 * weights.col[:, None] + np.arange(4)
        at = np.repeat(weights.row, 4)
        return sp.csr_matrix(
            (values.ravel(), (at, columns.ravel())), shape=(len(rows), 4 * len(self._chosen))
        )

    def _stiffness(self, rest: np.ndarray) -> np.ndarray:
        """(4 M, 4 M): what neighbouring motions differ by, at the middle between their nodes."""
        first, second = self._edges.T
        nodes = rest[self._chosen]
        half = (nodes[second] - nodes[first]) / 2
        m = len(self._chosen)
        ones, rows = np.ones((len(half), 1)), np.arange(len(half))[:, None]

        def block(values: np.ndarray, node: np.ndarray, columns: np.ndarray) -> sp.csr_matrix:
            at = 4 * node[:, None] + columns
            return sp.csr_matrix(
                (values.ravel(), (np.broadcast_to(rows, at.shape).ravel(), at.ravel())),
                shape=(len(rows), 4 * m),
            )

        place = block(np.hstack([half, ones]), first, np.arange(4)) - block(
            np.hstack([-half, ones]), second, np.arange(4)
        )
        total = place.T @ place
        for axis in range(3):
            turn = block(ones, first, np.array([axis])) - block(ones, second, np.array([axis]))
            total = total + self._settings.bend_m**2 * (turn.T @ turn)
        return total.toarray() / len(half)

    def lay(
        self, rest: np.ndarray, surface: TargetSurface, outward: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Places (V, 3) of the rest vertices after all steps; `outward` gives their normals."""
        places = rest
        diagonal = np.arange(self._base.shape[1])
        for stiffness in self._settings.stiffness:
            normals = outward(places)[self._points]
            goal, inside = surface.closest(places[self._points], normals)
            data = self._data[inside]
            system = (data.T @ data / len(self._points)).toarray(order="F")
            system += stiffness * self._smooth
            system[diagonal, diagonal] += 1e-9
            pull = data.T @ (goal - rest[self._points])[inside] / len(self._points)
            factor = cho_factor(system, check_finite=False, overwrite_a=True)
            places = rest + self._base @ cho_solve(factor, pull, check_finite=False)
        return places


def _farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Ids of at most `count` points (P, 3) by farthest point sampling, starting with point 0."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(points), np.inf)
    planes = np.ascontiguousarray(points.T)
    for index in range(1, count):
        x, y, z = planes - planes[:, chosen[index - 1], None]
        np.minimum(distance, x * x + y * y + z * z, out=distance)
        chosen[index] = distance.argmax()
    return chosen
