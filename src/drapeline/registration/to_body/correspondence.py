"""Which point of the garment each body vertex stands for, and the mask of those that have one."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import warp as wp
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from drapeline.geometry.mesh import edge_graph, faces_within, vertex_normals
from drapeline.geometry.warp_mesh import warp_mesh

_REACH_M = 0.08  # deformed cloth further from the body than this was not laid on it
_SNAP_EDGES = (
    0.5  # a vertex beyond the cloth by less than this many body edges stands for its boundary
)
_END_M = 0.04  # cloth that goes on beyond the body's open ends by less than this is drawn in
_ALIKE = 0.2  # least cosine between the normals of a body vertex and of its cloth
_ROUNDS = 6
_SLIT_M = 0.025  # boundaries closer to one another than this may be the two sides of a slit
# ... if over the cloth they are further apart than this, and than thrice the way across.
_APART_M = 0.045
_OVERLAP_M = 0.003


@dataclass(frozen=True)
class Correspondence:
    """Body vertices and their points on a garment.

    Attributes:
        mask: (V,) bool.
        corner: (V, 3) int32 garment vertices whose triangle or edge holds the point; 0 outside
            of the mask.
        bary: (V, 3) float32 weights of the corners, which sum to 1 within the mask.
        holes, islands: of the mask, before it was cleaned.
    """

    mask: np.ndarray
    corner: np.ndarray
    bary: np.ndarray
    holes: int
    islands: int

    def points(self, garment: np.ndarray) -> np.ndarray:
        """(V, 3) float32 places on garment vertices (..., C, 3), zero outside of the mask."""
        return (garment[self.corner] * self.bary[..., None]).sum(1).astype(np.float32)

    def offsets(self, garment: np.ndarray, body: np.ndarray) -> np.ndarray:
        """X = C - T (V, 3) float32 metres, zero outside of the mask."""
        return np.where(self.mask[:, None], self.points(garment) - body, 0).astype(np.float32)


class BodyMesh:
    """A topology of the body, and what a mask on it looks like: pieces, holes and border.

    Attributes:
        faces: (F, 3).
        pairs: (E, 2) edges.
        used: (V,) bool, vertices that faces have.
        ends: (V,) bool, vertices on the body's own open ends.
    """

    def __init__(self, faces: np.ndarray, count: int) -> None:
        """Index the edges of `faces` over `count` vertices."""
        self.faces = faces
        self._count = count
        half = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
        key, sides = np.unique(half.astype(np.int64) @ np.array([count, 1]), return_inverse=True)
        self.pairs = np.stack(np.divmod(key, count), axis=1)
        self._sides = sides.reshape(faces.shape)  # edge on each side of each face
        self.used = np.zeros(count, dtype=bool)
        self.used[faces] = True
        self.ends = np.zeros(count, dtype=bool)
        self.ends[self._border_pairs(np.ones(count, dtype=bool))] = True

    def spacing(self, body: np.ndarray) -> np.ndarray:
        """(V,) mean length of each vertex's edges, for body vertices (V, 3)."""
        pairs = self.pairs
        length = np.linalg.norm(body[pairs[:, 0]] - body[pairs[:, 1]], axis=1)
        total = np.bincount(pairs.ravel(), np.repeat(length, 2), self._count)
        return total / np.maximum(np.bincount(pairs.ravel(), minlength=self._count), 1)

    def holes(self, mask: np.ndarray) -> int:
        """Pieces of bare body that are enclosed by cloth."""
        piece = self._hole_pieces(mask)
        return len(np.unique(piece[piece >= 0]))

    def islands(self, mask: np.ndarray) -> int:
        """Pieces of the mask besides the largest."""
        piece = self._pieces(mask)
        return max(len(np.unique(piece[mask])) - 1, 0)

    def border(self, mask: np.ndarray) -> np.ndarray:
        """(V,) bool, vertices on the border of the mask's faces."""
        border = np.zeros(self._count, dtype=bool)
        border[self._border_pairs(mask)] = True
        return border

    def cleaned(self, mask: np.ndarray, slit: np.ndarray) -> np.ndarray:
        """The mask in one piece, without holes but a slit (V,), whose faces have simple borders."""
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
            # Where the border meets itself it would not be a line.
            meeting = np.bincount(self._border_pairs(mask).ravel(), minlength=self._count)
            cleaner = covered & (meeting <= 2)
            if (cleaner == mask).all():
                break
            mask = cleaner
        return mask

    def _border_pairs(self, mask: np.ndarray) -> np.ndarray:
        """(B, 2) edges that one face of the mask has."""
        sides = self._sides[mask[self.faces].all(axis=1)]
        return self.pairs[np.bincount(sides.ravel(), minlength=len(self.pairs)) == 1]

    def _pieces(self, chosen: np.ndarray) -> np.ndarray:
        """(V,) number of the piece each chosen vertex is in, -1 for the others."""
        pairs = self.pairs[chosen[self.pairs].all(axis=1)]
        _, label = connected_components(edge_graph(pairs, self._count), directed=False)
        return np.where(chosen, label, -1)

    def _hole_pieces(self, mask: np.ndarray) -> np.ndarray:
        """(V,) piece of each bare vertex from which no open end can be reached, else -1."""
        piece = self._pieces(~mask & self.used)
        return np.where(np.isin(piece, piece[self.ends]), -1, piece)


def correspond(
    body: np.ndarray, mesh: BodyMesh, laid: np.ndarray, triangles: np.ndarray
) -> Correspondence:
    """Body vertices that lie under a garment which was laid on the body.

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
    face, bary = _nearest(body, normals, laid, triangles, _ALIKE)
    found = face >= 0
    corner = triangles[np.where(found, face, 0)]
    boundary = _Boundary(triangles, laid)
    spacing = mesh.spacing(body)
    point = (laid[corner] * bary[..., None]).sum(1)
    gap = body - point
    aside = np.linalg.norm(gap - (gap * normals).sum(1, keepdims=True) * normals, axis=1)
    on_boundary = boundary.holds(corner, bary)
    mask = found & (~on_boundary | (aside < _SNAP_EDGES * spacing)) & mesh.used
    slit = _slit(mesh, mask, corner, bary, boundary, _lengths(laid, triangles))
    cleaned = mesh.cleaned(mask, slit)
    _adopt(cleaned & ~found, body, normals, laid, triangles, corner, bary)
    _draw_to_boundary(mesh, cleaned, point, on_boundary, boundary, spacing, corner, bary)
    bary[~cleaned], corner[~cleaned] = 0, 0
    return Correspondence(
        cleaned,
        corner.astype(np.int32),
        bary.astype(np.float32),
        mesh.holes(mask),
        mesh.islands(mask),
    )


class _Boundary:
    """The openings of a garment that was laid on the body."""

    def __init__(self, triangles: np.ndarray, laid: np.ndarray) -> None:
        half = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        across = np.roll(triangles, 1, axis=1).ravel()
        self._base = np.array([len(laid), 1])
        key, first, uses = np.unique(
            np.sort(half, axis=1).astype(np.int64) @ self._base,
            return_index=True,
            return_counts=True,
        )
        self._keys, lone = key[uses == 1], first[uses == 1]
        self._pairs = half[lone]
        self._laid = laid
        self._at_boundary = np.zeros(len(laid), dtype=bool)
        self._at_boundary[self._pairs] = True
        start, end = laid[self._pairs[:, 0]], laid[self._pairs[:, 1]]
        axis = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-12)
        inward = laid[across[lone]] - start
        self._inward = inward - (inward * axis).sum(1, keepdims=True) * axis

    def __len__(self) -> int:
        return len(self._pairs)

    def holds(self, corner: np.ndarray, bary: np.ndarray) -> np.ndarray:
        """Whether points, given by corners (P, 3) and weights (P, 3), lie on the boundary."""
        on = ((bary > 1 - 1e-6) & self._at_boundary[corner]).any(axis=1)
        for i in range(3):
            edge = np.sort(corner[:, [(i + 1) % 3, (i + 2) % 3]], axis=1) @ self._base
            on |= (bary[:, i] < 1e-6) & np.isin(edge, self._keys)
        return on

    def within(self, points: np.ndarray, reach_m: float) -> np.ndarray:
        """Whether a vertex of the boundary is within reach of points (P, 3)."""
        ids = np.unique(self._pairs)
        distance, _ = KDTree(self._laid[ids]).query(points, distance_upper_bound=reach_m)
        return np.isfinite(distance)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Closest places, for points (P, 3) of the cloth, on the boundary around them.

        Returns:
            Corners (P, 3) of which the last repeats the first, weights (P, 3) and distances (P,).
            Where two boundaries lie side by side, the other one does not count.
        """
        start = self._laid[self._pairs[:, 0]]
        axis = self._laid[self._pairs[:, 1]] - start
        gap = points[:, None] - start
        along = np.einsum("pei,ei->pe", gap, axis) / np.maximum((axis**2).sum(1), 1e-20)
        along = np.clip(along, 0, 1)
        away = gap - along[..., None] * axis
        distance = np.linalg.norm(away, axis=-1)
        beyond = np.einsum("pei,ei->pe", away, self._inward) < 0
        ranked = distance + np.where(beyond & (distance > _OVERLAP_M), 1.0, 0.0)
        best, rows = ranked.argmin(axis=1), np.arange(len(points))
        share = along[rows, best]
        corner = self._pairs[best][:, [0, 1, 0]]
        weights = np.column_stack([1 - share, share, 0 * share])
        return corner, weights, distance[rows, best]

    def places(self, corner: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(P, 3) where corners and weights are."""
        return (self._laid[corner] * weights[..., None]).sum(1)


def _slit(
    mesh: BodyMesh,
    mask: np.ndarray,
    corner: np.ndarray,
    bary: np.ndarray,
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
    close[mask] = boundary.within(boundary.places(corner[mask], bary[mask]), _SLIT_M)
    pairs = mesh.pairs[close[mesh.pairs].all(axis=1)]
    ids, rank = np.unique(pairs, return_inverse=True)
    if not len(ids):
        return left_out
    rank = rank.reshape(-1, 2)
    place = boundary.places(corner[ids], bary[ids])
    _, _, distance = boundary.nearest(place)
    both = corner[ids][rank]  # (E, 2, 3)
    rank = rank[~(both[:, 0, :, None] == both[:, 1, None, :]).any(axis=(1, 2))]
    ends = np.take_along_axis(corner[ids], bary[ids].argmax(axis=1)[:, None], axis=1)[rank, 0]
    starts, row = np.unique(ends[:, 0], return_inverse=True)
    if not len(starts):
        return left_out
    far = np.maximum(_APART_M, 3 * np.linalg.norm(place[rank[:, 0]] - place[rank[:, 1]], axis=1))
    way = dijkstra(cloth, directed=False, indices=starts, limit=far.max())
    rank = rank[way[row, ends[:, 1]] > far]
    left_out[ids[_cover(rank, distance)]] = True
    return left_out


def _cover(pairs: np.ndarray, cost: np.ndarray) -> list[int]:
    """Few vertices, cheap ones (V,) by preference, such that each pair (E, 2) has one of them."""
    often = np.bincount(pairs.ravel(), minlength=len(cost))
    chosen: set[int] = set()
    order = np.argsort(-often[pairs].max(axis=1), kind="stable")
    for a, b in pairs[order].tolist():
        if a not in chosen and b not in chosen:
            chosen.add(min((-often[a], cost[a], a), (-often[b], cost[b], b))[2])
    return sorted(chosen)


def _lengths(laid: np.ndarray, triangles: np.ndarray) -> sp.csr_matrix:
    """(C, C) lengths of the garment's edges."""
    half = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    length = np.linalg.norm(laid[half[:, 0]] - laid[half[:, 1]], axis=1)
    graph = sp.csr_matrix((length, half.T), shape=(len(laid), len(laid)))
    return graph.maximum(graph.T)


def _adopt(wanted, body, normals, laid, triangles, corner, bary) -> None:
    """Points for filled holes: the closest cloth, whichever way it faces."""
    if not wanted.any():
        return
    face, weights = _nearest(body[wanted], normals[wanted], laid, triangles, -1.1)
    lost = face < 0
    if lost.any():
        _, near = KDTree(laid).query(body[wanted][lost])
        owner = np.zeros(len(laid), dtype=np.int64)
        owner[triangles] = np.arange(len(triangles))[:, None]
        face[lost] = owner[near]
        weights[lost] = triangles[face[lost]] == near[:, None]
    corner[wanted], bary[wanted] = triangles[face], weights


def _draw_to_boundary(mesh, mask, point, on_boundary, boundary, spacing, corner, bary) -> None:
    """Move the points of the mask's border onto the garment's boundary where that is near."""
    border = np.flatnonzero(mesh.border(mask) & ~on_boundary)
    if not len(border) or not len(boundary):
        return
    edge, share, distance = boundary.nearest(point[border])
    limit = np.where(mesh.ends[border], _END_M, 2 * spacing[border] + 0.005)
    near = distance < limit
    corner[border[near]], bary[border[near]] = edge[near], share[near]


@wp.func
def _weights_of(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Barycentric weights of the point of a triangle that is closest to p (Ericson 2005, 5.1.5)."""
    ab = b - a
    ac = c - a
    ap = p - a
    d1 = wp.dot(ab, ap)
    d2 = wp.dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    bp = p - b
    d3 = wp.dot(ab, bp)
    d4 = wp.dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return wp.vec3(0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / wp.max(d1 - d3, 1.0e-20)
        return wp.vec3(1.0 - v, v, 0.0)
    cp = p - c
    d5 = wp.dot(ab, cp)
    d6 = wp.dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return wp.vec3(0.0, 0.0, 1.0)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / wp.max(d2 - d6, 1.0e-20)
        return wp.vec3(1.0 - w, 0.0, w)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / wp.max((d4 - d3) + (d5 - d6), 1.0e-20)
        return wp.vec3(0.0, 1.0 - w, w)
    scale = 1.0 / wp.max(va + vb + vc, 1.0e-20)
    return wp.vec3(1.0 - (vb + vc) * scale, vb * scale, vc * scale)


@wp.kernel
def _find(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    reach: float,
    alike: float,
    face: wp.array(dtype=int),
    weights: wp.array(dtype=wp.vec3),
):
    """Closest point among the triangles that face the same way, in boxes that grow."""
    index = wp.tid()
    point = points[index]
    normal = normals[index]
    best = reach
    size = reach / 8.0
    face[index] = -1
    indices = wp.mesh_get(mesh).indices
    places = wp.mesh_get(mesh).points
    while size <= reach:
        half = wp.vec3(size, size, size)
        query = wp.mesh_query_aabb(mesh, point - half, point + half)
        other = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
        while wp.mesh_query_aabb_next(query, other):
            a = places[indices[3 * other]]
            b = places[indices[3 * other + 1]]
            c = places[indices[3 * other + 2]]
            flat = wp.normalize(wp.cross(b - a, c - a))
            if wp.dot(flat, normal) > alike:
                w = _weights_of(point, a, b, c)
                away = wp.length(point - (w[0] * a + w[1] * b + w[2] * c))
                if away < best:
                    best = away
                    face[index] = other
                    weights[index] = w
        size = 2.0 * reach if best <= size else 2.0 * size


def _nearest(
    points: np.ndarray,
    normals: np.ndarray,
    vertices: np.ndarray,
    triangles: np.ndarray,
    alike: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Closest triangle that faces the same way: id (P,) or -1, and weights (P, 3)."""
    device = "cpu"

    def array(values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    mesh = warp_mesh(vertices, triangles)
    count = len(points)
    face = wp.zeros(count, dtype=int, device=device)
    weights = wp.zeros(count, dtype=wp.vec3, device=device)
    wp.launch(
        _find,
        dim=count,
        inputs=[
            mesh.id,
            array(points.astype(np.float32), wp.vec3),
            array(normals.astype(np.float32), wp.vec3),
            _REACH_M,
            float(alike),
        ],
        outputs=[face, weights],
        device=device,
    )
    return face.numpy().copy(), weights.numpy().astype(np.float64)
