"""Matching of body vertices with points on a garment, and the mask of the vertices it covers."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from drapeline.geometry.closest import closest_facing
from drapeline.geometry.mesh import (
    edge_graph,
    edge_lengths,
    faces_within,
    half_edges,
    vertex_normals,
)

_ROUNDS = 6  # of cleaning


class BodyMesh:
    """A topology of the body, which tells what a mask of its vertices looks like.

    A mask covers the faces whose corners are all in it.

    Args:
        faces: (F, 3), kept as an attribute.
        count: V, number of vertices.

    Attributes:
        pairs: (E, 2) edges.
        used: (V,) bool, vertices that belong to faces.
        ends: (V,) bool, vertices on the body's own open ends.
    """

    def __init__(self, faces: np.ndarray, count: int) -> None:
        self.faces = faces
        self._count = count
        half = np.sort(half_edges(faces), axis=1)
        key, sides = np.unique(half.astype(np.int64) @ np.array([count, 1]), return_inverse=True)
        self.pairs = np.stack(np.divmod(key, count), axis=1)
        self._sides = sides.reshape(faces.shape)  # edge on each side of each face
        self.used = np.zeros(count, dtype=bool)
        self.used[faces] = True
        self.ends = np.zeros(count, dtype=bool)
        self.ends[self._border_pairs(np.ones(count, dtype=bool))] = True

    def spacing(self, body: np.ndarray) -> np.ndarray:
        """Mean length (V,) of each vertex's edges, for body vertices (V, 3)."""
        pairs = self.pairs
        length = edge_lengths(body, pairs)
        total = np.bincount(pairs.ravel(), np.repeat(length, 2), self._count)
        return total / np.maximum(np.bincount(pairs.ravel(), minlength=self._count), 1)

    def holes(self, mask: np.ndarray) -> int:
        """Number of pieces of bare body that the mask (V,) encloses."""
        piece = self._hole_pieces(mask)
        return len(np.unique(piece[piece >= 0]))

    def islands(self, mask: np.ndarray) -> int:
        """Number of pieces of the mask (V,) besides the largest."""
        piece = self._pieces(mask)
        return max(len(np.unique(piece[mask])) - 1, 0)

    def border(self, mask: np.ndarray) -> np.ndarray:
        """Vertices (V,) bool on the border of the mask's faces."""
        border = np.zeros(self._count, dtype=bool)
        border[self._border_pairs(mask)] = True
        return border

    def clean(self, mask: np.ndarray, slit: np.ndarray) -> np.ndarray:
        """The mask (V,) in one piece, without holes but the slit (V,); no border meets itself."""
        mask = (mask | (self._hole_pieces(mask) >= 0)) & ~slit
        mask = mask | (self._hole_pieces(mask) >= 0)  # a slit leads to an opening
        for _ in range(_ROUNDS):
            if not mask.any():
                break
            kept = faces_within(self.faces, mask)
            graph = sp.coo_matrix(
                (np.ones(2 * len(kept)), kept[:, [0, 1, 0, 2]].reshape(-1, 2).T),
                shape=(self._count, self._count),
            )
            _, piece = connected_components(graph, directed=False)
            mask = mask & (piece == np.bincount(piece).argmax())
            covered = np.zeros(self._count, dtype=bool)
            covered[faces_within(self.faces, mask)] = True
            meeting = np.bincount(self._border_pairs(mask).ravel(), minlength=self._count)
            cleaner = covered & (meeting <= 2)
            if (cleaner == mask).all():
                break
            mask = cleaner
        return mask

    def _border_pairs(self, mask: np.ndarray) -> np.ndarray:
        """(B, 2) edges that belong to a single face of the mask."""
        sides = self._sides[mask[self.faces].all(axis=1)]
        return self.pairs[np.bincount(sides.ravel(), minlength=len(self.pairs)) == 1]

    def _pieces(self, chosen: np.ndarray) -> np.ndarray:
        """(V,) number of the piece that each chosen vertex is in, -1 for the others."""
        pairs = self.pairs[chosen[self.pairs].all(axis=1)]
        _, label = connected_components(edge_graph(pairs, self._count), directed=False)
        return np.where(chosen, label, -1)

    def _hole_pieces(self, mask: np.ndarray) -> np.ndarray:
        """(V,) piece of each bare vertex from which no open end can be reached, else -1."""
        piece = self._pieces(~mask & self.used)
        return np.where(np.isin(piece, piece[self.ends]), -1, piece)


_REACH_M = 0.08  # deformed cloth further from the body than this was not laid on it
# A vertex that misses the cloth by less than this many body edges stands for its boundary.
_SNAP_EDGES = 0.5
_END_M = 0.04  # cloth that goes on beyond the body's open ends by less than this is drawn in
_ALIKE = 0.2  # least cosine between the normals of a body vertex and of its cloth
_ANY_WAY = -1.1  # a least cosine that all normals meet
_SLIT_M = 0.025  # boundaries closer to one another than this may be the two sides of a slit
# ... if over the cloth they are further apart than this, and than three times the way across.
_APART_M = 0.045
_OVERLAP_M = 0.003


@dataclass(frozen=True)
class Correspondence:
    """Body vertices and their points on a garment."""

    mask: np.ndarray  # (V,) bool
    # (V, 3) int32 garment vertices whose triangle or edge holds the point; 0 outside the mask.
    corner: np.ndarray
    bary: np.ndarray  # (V, 3) float32 weights of the corners, which sum to 1 within the mask
    # holes, islands: of the mask, before it was cleaned.
    holes: int
    islands: int

    def points(self, garment: np.ndarray) -> np.ndarray:
        """Points (V, 3) float32 on garment vertices (C, 3), zero outside the mask."""
        return (garment[self.corner] * self.bary[..., None]).sum(1).astype(np.float32)

    def offsets(self, garment: np.ndarray, body: np.ndarray) -> np.ndarray:
        """X = C - T (V, 3) float32 metres of garment (C, 3) and body (V, 3), zero if unmasked."""
        return np.where(self.mask[:, None], self.points(garment) - body, 0).astype(np.float32)


@dataclass(frozen=True)
class _ClothPoints:
    """Points on a garment: corners (P, 3), ids of vertices, and float64 weights (P, 3)."""

    corner: np.ndarray
    bary: np.ndarray

    def places(self, vertices: np.ndarray) -> np.ndarray:
        """(P, 3) where the points lie on vertices (C, 3)."""
        return (vertices[self.corner] * self.bary[..., None]).sum(1)

    def take(self, rows: np.ndarray) -> "_ClothPoints":
        """Some of the points, by ids or a mask."""
        return _ClothPoints(self.corner[rows], self.bary[rows])

    def replace(self, rows: np.ndarray, others: "_ClothPoints") -> "_ClothPoints":
        """The points with others in some rows, given by ids or a mask."""
        corner, bary = self.corner.copy(), self.bary.copy()
        corner[rows], bary[rows] = others.corner, others.bary
        return _ClothPoints(corner, bary)


def correspond(
    body: np.ndarray, mesh: BodyMesh, laid: np.ndarray, triangles: np.ndarray
) -> Correspondence:
    """Match body vertices with the cloth over them, for a garment that was laid on the body.

    A vertex is in the mask if its closest cloth that faces the same way is within the garment, or
    if it misses the boundary by less than half an edge of the body. The vertices along the mask's
    border are then moved onto the boundary, so that hems and necklines come out as they are.

    Args:
        body: (V, 3) vertices.
        mesh: topology of the body to use.
        laid: (C, 3) the garment deformed onto the body.
        triangles: (G, 3) of the garment.
    """
    body = np.asarray(body, dtype=np.float64)
    normals = vertex_normals(body, mesh.faces)
    face, bary = closest_facing(
        body, normals, laid, triangles, reach_m=_REACH_M, least_cosine=_ALIKE
    )
    matched = face >= 0
    points = _ClothPoints(triangles[np.where(matched, face, 0)], bary)
    place = points.places(laid)
    boundary = _Boundary(triangles, laid)
    spacing = mesh.spacing(body)
    gap = body - place
    aside = np.linalg.norm(gap - (gap * normals).sum(1, keepdims=True) * normals, axis=1)
    on_boundary = boundary.holds(points)
    mask = matched & (~on_boundary | (aside < _SNAP_EDGES * spacing)) & mesh.used
    slit = _find_slit(mesh, mask, points, boundary, _edge_lengths_graph(laid, triangles))
    cleaned = mesh.clean(mask, slit)
    filled = cleaned & ~matched
    if filled.any():
        adopted = _closest_any_way(body[filled], normals[filled], laid, triangles)
        points = points.replace(filled, adopted)
    border = np.flatnonzero(mesh.border(cleaned) & ~on_boundary)
    if len(border) and len(boundary):
        limit = np.where(mesh.ends[border], _END_M, 2 * spacing[border] + 0.005)
        drawn, distance = boundary.nearest(place[border])
        near = distance < limit
        points = points.replace(border[near], drawn.take(near))
    return Correspondence(
        cleaned,
        np.where(cleaned[:, None], points.corner, 0).astype(np.int32),
        np.where(cleaned[:, None], points.bary, 0).astype(np.float32),
        mesh.holes(mask),
        mesh.islands(mask),
    )


class _Boundary:
    """The openings of a garment that was laid on the body.

    Args:
        triangles: (G, 3) of the garment.
        laid: (C, 3) its vertices, kept as an attribute.
    """

    def __init__(self, triangles: np.ndarray, laid: np.ndarray) -> None:
        half = half_edges(triangles)
        across = np.roll(triangles, 1, axis=1).ravel()
        self._base = np.array([len(laid), 1])
        key, first, uses = np.unique(
            np.sort(half, axis=1).astype(np.int64) @ self._base,
            return_index=True,
            return_counts=True,
        )
        self._keys, lone = key[uses == 1], first[uses == 1]
        self._pairs = half[lone]
        self.laid = laid
        self._at_boundary = np.zeros(len(laid), dtype=bool)
        self._at_boundary[self._pairs] = True
        start, end = laid[self._pairs[:, 0]], laid[self._pairs[:, 1]]
        axis = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-12)
        inward = laid[across[lone]] - start
        self._inward = inward - (inward * axis).sum(1, keepdims=True) * axis

    def __len__(self) -> int:
        return len(self._pairs)

    def holds(self, points: _ClothPoints) -> np.ndarray:
        """Whether points lie on the boundary: (P,) bool."""
        corner, bary = points.corner, points.bary
        on = ((bary > 1 - 1e-6) & self._at_boundary[corner]).any(axis=1)
        for i in range(3):
            edge = np.sort(corner[:, [(i + 1) % 3, (i + 2) % 3]], axis=1) @ self._base
            on |= (bary[:, i] < 1e-6) & np.isin(edge, self._keys)
        return on

    def within(self, points: _ClothPoints, reach_m: float) -> np.ndarray:
        """Whether a vertex of the boundary is within reach of points: (P,) bool."""
        ids = np.unique(self._pairs)
        distance, _ = KDTree(self.laid[ids]).query(
            points.places(self.laid), distance_upper_bound=reach_m
        )
        return np.isfinite(distance)

    def nearest(self, places: np.ndarray) -> tuple[_ClothPoints, np.ndarray]:
        """Points of the boundary that are closest to places (P, 3) on the cloth within it.

        Where two boundaries lie side by side, the other one does not count.

        Returns:
            Points, the last of whose corners repeats the first, and distances (P,).
        """
        start = self.laid[self._pairs[:, 0]]
        axis = self.laid[self._pairs[:, 1]] - start
        gap = places[:, None] - start
        along = np.einsum("pei,ei->pe", gap, axis) / np.maximum((axis**2).sum(1), 1e-20)
        along = np.clip(along, 0, 1)
        away = gap - along[..., None] * axis
        distance = np.linalg.norm(away, axis=-1)
        beyond = np.einsum("pei,ei->pe", away, self._inward) < 0
        ranked = distance + np.where(beyond & (distance > _OVERLAP_M), 1.0, 0.0)
        best, rows = ranked.argmin(axis=1), np.arange(len(places))
        share = along[rows, best]
        corner = self._pairs[best][:, [0, 1, 0]]
        points = _ClothPoints(corner, np.column_stack([1 - share, share, 0 * share]))
        return points, distance[rows, best]


def _find_slit(
    mesh: BodyMesh,
    mask: np.ndarray,
    points: _ClothPoints,
    boundary: _Boundary,
    cloth: sp.csr_matrix,
) -> np.ndarray:
    """(V,) vertices to leave out so that cloth which meets cloth, boundary to boundary, stays open.

    The fronts of an open shirt lie side by side. An edge of the body that leads from one to the
    other has ends that are far from one another over the cloth; one of the two is left out.
    `cloth` holds the lengths of the garment's edges.
    """
    left_out = np.zeros(len(mask), dtype=bool)
    if not len(boundary):
        return left_out
    close = np.zeros(len(mask), dtype=bool)
    close[mask] = boundary.within(points.take(mask), _SLIT_M)
    pairs = mesh.pairs[close[mesh.pairs].all(axis=1)]
    ids, rank = np.unique(pairs, return_inverse=True)
    if not len(ids):
        return left_out
    rank = rank.reshape(-1, 2)
    near = points.take(ids)
    place = near.places(boundary.laid)
    _, distance = boundary.nearest(place)
    both = near.corner[rank]  # (E, 2, 3)
    rank = rank[~(both[:, 0, :, None] == both[:, 1, None, :]).any(axis=(1, 2))]
    heaviest = near.bary.argmax(axis=1)[:, None]
    ends = np.take_along_axis(near.corner, heaviest, axis=1)[rank, 0]
    starts, row = np.unique(ends[:, 0], return_inverse=True)
    if not len(starts):
        return left_out
    far = np.maximum(_APART_M, 3 * edge_lengths(place, rank))
    way = dijkstra(cloth, directed=False, indices=starts, limit=far.max())
    rank = rank[way[row, ends[:, 1]] > far]
    left_out[ids[_cover_pairs(rank, distance)]] = True
    return left_out


def _cover_pairs(pairs: np.ndarray, cost: np.ndarray) -> list[int]:
    """Few vertices, cheap ones (V,) by preference, such that each pair (E, 2) has one of them."""
    often = np.bincount(pairs.ravel(), minlength=len(cost))
    chosen: set[int] = set()
    order = np.argsort(-often[pairs].max(axis=1), kind="stable")
    for a, b in pairs[order].tolist():
        if a not in chosen and b not in chosen:
            chosen.add(min((-often[a], cost[a], a), (-often[b], cost[b], b))[2])
    return sorted(chosen)


def _edge_lengths_graph(laid: np.ndarray, triangles: np.ndarray) -> sp.csr_matrix:
    """(C, C) lengths of the garment's edges."""
    half = half_edges(triangles)
    graph = sp.csr_matrix((edge_lengths(laid, half), half.T), shape=(len(laid), len(laid)))
    return graph.maximum(graph.T)


def _closest_any_way(
    body: np.ndarray, normals: np.ndarray, laid: np.ndarray, triangles: np.ndarray
) -> _ClothPoints:
    """Points for body vertices (P, 3) in filled holes: the closest cloth, however it faces."""
    face, bary = closest_facing(
        body, normals, laid, triangles, reach_m=_REACH_M, least_cosine=_ANY_WAY
    )
    lost = face < 0
    if lost.any():
        _, near = KDTree(laid).query(body[lost])
        owner = np.zeros(len(laid), dtype=np.int64)
        owner[triangles] = np.arange(len(triangles))[:, None]
        face[lost] = owner[near]
        bary[lost] = triangles[face[lost]] == near[:, None]
    return _ClothPoints(triangles[face], bary)
