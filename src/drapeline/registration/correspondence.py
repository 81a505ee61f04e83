"""Which point of the garment each body vertex stands for, and the mask of those that have one."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import warp as wp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.mesh import vertex_normals

wp.config.quiet = True

_REACH_M = 0.08  # deformed cloth further from the body than this was not laid on it
_SNAP_EDGES = 0.5  # a vertex beyond the cloth by less than this many body edges stands for its rim
_END_M = 0.04  # cloth that goes on beyond the body's open ends by less than this is drawn in
_ALIKE = 0.2  # least cosine between the normals of a body vertex and of its cloth
_ROUNDS = 6


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
        used: (V,) bool, vertices that faces have.
        ends: (V,) bool, vertices on the body's own open ends.
    """

    def __init__(self, faces: np.ndarray, count: int) -> None:
        """Index the edges of `faces` over `count` vertices."""
        self.faces = faces
        self._count = count
        half = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
        key, sides = np.unique(half.astype(np.int64) @ np.array([count, 1]), return_inverse=True)
        self._pairs = np.stack(np.divmod(key, count), axis=1)
        self._sides = sides.reshape(faces.shape)  # edge on each side of each face
        self.used = np.zeros(count, dtype=bool)
        self.used[faces] = True
        self.ends = np.zeros(count, dtype=bool)
        self.ends[self._border_pairs(np.ones(count, dtype=bool))] = True

    def spacing(self, body: np.ndarray) -> np.ndarray:
        """(V,) mean length of each vertex's edges, for body vertices (V, 3)."""
        pairs = self._pairs
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

    def cleaned(self, mask: np.ndarray) -> np.ndarray:
        """The mask in one piece, without holes, whose faces have simple borders."""
        mask = mask | (self._hole_pieces(mask) >= 0)
        for _ in range(_ROUNDS):
            if not mask.any():
                break
            piece = self._pieces(mask)
            mask = piece == np.bincount(piece[mask]).argmax()
            covered = np.zeros(self._count, dtype=bool)
            covered[mask_faces(self.faces, mask)] = True
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
        return self._pairs[np.bincount(sides.ravel(), minlength=len(self._pairs)) == 1]

    def _pieces(self, chosen: np.ndarray) -> np.ndarray:
        """(V,) number of the piece each chosen vertex is in, -1 for the others."""
        pairs = self._pairs[chosen[self._pairs].all(axis=1)]
        graph = sp.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(self._count, self._count))
        _, label = connected_components(graph, directed=False)
        return np.where(chosen, label, -1)

    def _hole_pieces(self, mask: np.ndarray) -> np.ndarray:
        """(V,) piece of each bare vertex from which no open end can be reached, else -1."""
        piece = self._pieces(~mask & self.used)
        return np.where(np.isin(piece, piece[self.ends]), -1, piece)


def rim_edges(triangles: np.ndarray) -> np.ndarray:
    """(R, 2) edges that one triangle has."""
    half = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1)
    count = int(triangles.max()) + 1
    key, uses = np.unique(
        half.reshape(-1, 2).astype(np.int64) @ np.array([count, 1]), return_counts=True
    )
    return np.stack(np.divmod(key[uses == 1], count), axis=1)


def mask_faces(faces: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(F', 3) faces with all corners in the mask (V,)."""
    return faces[mask[faces].all(axis=1)]


def correspond(
    body: np.ndarray, mesh: BodyMesh, laid: np.ndarray, triangles: np.ndarray
) -> Correspondence:
    """Body vertices that lie under a garment which was laid on the body.

    A vertex is in the mask if its closest cloth that faces the same way is within the garment, or
    if it misses the rim by less than half an edge of the body. The vertices along the mask's border
    are then moved onto the rim, so that hems and necklines come out as they are.

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
    rim = rim_edges(triangles)
    spacing = mesh.spacing(body)
    gap = body - (laid[corner] * bary[..., None]).sum(1)
    aside = np.linalg.norm(gap - (gap * normals).sum(1, keepdims=True) * normals, axis=1)
    on_rim = _on_rim(corner, bary, rim, len(laid))
    mask = found & (~on_rim | (aside < _SNAP_EDGES * spacing)) & mesh.used
    cleaned = mesh.cleaned(mask)
    _adopt(cleaned & ~found, body, normals, laid, triangles, corner, bary)
    _draw_to_rim(mesh, cleaned, body, laid, rim, spacing, corner, bary)
    bary[~cleaned], corner[~cleaned] = 0, 0
    return Correspondence(
        cleaned,
        corner.astype(np.int32),
        bary.astype(np.float32),
        mesh.holes(mask),
        mesh.islands(mask),
    )


def _on_rim(corner: np.ndarray, bary: np.ndarray, rim: np.ndarray, count: int) -> np.ndarray:
    """Whether points lie on an edge or a vertex of the rim."""
    at_rim = np.zeros(count, dtype=bool)
    at_rim[rim] = True
    key = np.sort(rim, axis=1) @ np.array([count, 1])
    zero = bary < 1e-6
    on = ((bary > 1 - 1e-6) & at_rim[corner]).any(axis=1)
    for i in range(3):
        edge = np.sort(corner[:, [(i + 1) % 3, (i + 2) % 3]], axis=1) @ np.array([count, 1])
        on |= zero[:, i] & np.isin(edge, key)
    return on


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


def _draw_to_rim(mesh, mask, body, laid, rim, spacing, corner, bary) -> None:
    """Move the points of the mask's border onto the garment's rim where that is near."""
    border = np.flatnonzero(mesh.border(mask))
    if not len(border) or not len(rim):
        return
    edge, share, distance = nearest_on_edges(body[border], laid, rim)
    limit = np.where(mesh.ends[border], _END_M, 1.5 * spacing[border] + 0.005)
    near = distance < limit
    corner[border[near]], bary[border[near]] = edge[near], share[near]


def nearest_on_edges(
    points: np.ndarray, vertices: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closest places of points (P, 3) on edges (E, 2) of vertices (V, 3).

    Returns:
        Corners (P, 3), of which the last repeats the first, weights (P, 3) and distances (P,).
    """
    start, axis = vertices[pairs[:, 0]], vertices[pairs[:, 1]] - vertices[pairs[:, 0]]
    gap = points[:, None] - start
    along = np.einsum("pei,ei->pe", gap, axis) / np.maximum((axis**2).sum(1), 1e-20)
    along = np.clip(along, 0, 1)
    distance = np.linalg.norm(gap - along[..., None] * axis, axis=-1)
    best, rows = distance.argmin(axis=1), np.arange(len(points))
    share = along[rows, best]
    corner = pairs[best][:, [0, 1, 0]]
    return corner, np.column_stack([1 - share, share, 0 * share]), distance[rows, best]


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


def nearest_places(
    points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Closest places of points (P, 3) on a mesh: corners (P, 3) and weights (P, 3)."""
    face, weights = _nearest(points, np.zeros_like(points), vertices, triangles, -1.1)
    if (face < 0).any():
        raise ValueError(f"{(face < 0).sum()} points are further than {_REACH_M} m from the mesh")
    return triangles[face], weights


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

    mesh = wp.Mesh(
        points=array(vertices.astype(np.float32), wp.vec3),
        indices=array(triangles.astype(np.int32).ravel(), int),
    )
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
