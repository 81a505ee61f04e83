"""Polygon meshes: the `Mesh` type, edges, boundaries and normals."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

_SLIVER_M2 = 1e-9  # twice the area of a triangle without a plane


@dataclass(frozen=True)
class Mesh:
    """A mesh of quads or of triangles, in metres.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 4) or (F, 3) int32, counter-clockwise seen from outside.
        uv: (T, 2) float32 texture coordinates or None.
        uv_faces: (F, 4) or (F, 3) int32 into `uv`, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    uv_faces: np.ndarray | None = None

    @property
    def corner_uv(self) -> np.ndarray | None:
        """(F, k, 2) texture coordinates of the faces' corners; None if there are none."""
        if self.uv is None or self.uv_faces is None:
            return None
        return self.uv[self.uv_faces]

    @property
    def triangles(self) -> np.ndarray:
        """(F', 3) int32; a quad (0,1,2,3) becomes (0,1,2) and (0,2,3) as CLOTH3D readers do."""
        return triangulate(self.faces)


def triangulate(faces: np.ndarray) -> np.ndarray:
    """Split quads (F, 4) into triangles (2 F, 3), the two halves of each next to one another.

    Triangles (F, 3) are returned as they are.
    """
    if faces.shape[1] == 3:
        return faces
    return faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def edges(faces: np.ndarray) -> np.ndarray:
    """Undirected edges (E, 2) of a polygon mesh: each once, smaller id first, in lexical order."""
    return edge_counts(faces)[0]


def edge_counts(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undirected edges (E, 2), as `edges` returns them, and the number of faces (E,) on each."""
    pairs, _, counts = _unique_edges(half_edges(faces))
    return pairs, counts


def face_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2) as `edges` returns them, and (F, C) ids of those from each corner on."""
    pairs, which, _ = _unique_edges(half_edges(faces))
    return pairs, which.reshape(faces.shape)


def half_edges(faces: np.ndarray) -> np.ndarray:
    """Directed edges (F * corners, 2), face by face; edge k leaves corner k."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def edge_lengths(vertices: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Lengths (E,) of edges (E, 2) between vertices (V, 3)."""
    return np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)


def mean_edge_length(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Mean length of a mesh's edges."""
    return float(edge_lengths(vertices, edges(faces)).mean())


def edge_graph(pairs: np.ndarray, count: int) -> csr_matrix:
    """Symmetric adjacency matrix (count, count) of undirected edges (E, 2), each given once."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_matrix((np.ones(len(both)), both.T), shape=(count, count))


def boundary_edges(faces: np.ndarray) -> np.ndarray:
    """Undirected edges (R, 2) that belong to a single face."""
    pairs, counts = edge_counts(faces)
    return pairs[counts == 1]


def faces_within(faces: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Faces (F', 3) all of whose corners are in the mask (V,)."""
    return faces[mask[faces].all(axis=1)]


def _unique_edges(half: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected edges (E, 2) in lexical order, the edge of each half, and halves per edge."""
    # Of two columns; `min(axis=1)` takes forty times as long.
    low, high = np.minimum(*half.T).astype(np.int64), np.maximum(*half.T)
    base = int(high.max(initial=0)) + 1
    # One number per edge sorts ten times faster than a row of two. With the index NumPy takes its
    # stable sort, three times as fast again: faces beside one another mostly have close corners.
    key, _, which, counts = np.unique(
        low * base + high, return_index=True, return_inverse=True, return_counts=True
    )
    return np.stack(np.divmod(key, base), axis=1).astype(half.dtype), which, counts


def boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Boundary loops, each an array of vertex ids in order, the longest first.

    Raises:
        ValueError: a boundary vertex has more than one boundary edge leaving it.
    """
    half = half_edges(faces)
    _, which, counts = _unique_edges(half)
    open_half = half[counts[which] == 1]
    follow: dict[int, int] = {}
    for start, end in open_half.tolist():
        if start in follow:
            raise ValueError(f"vertex {start} lies on more than one boundary loop")
        follow[start] = end
    loops = []
    while follow:
        start = next(iter(follow))
        loop = [start]
        while (after := follow.pop(loop[-1])) != start:
            loop.append(after)
        loops.append(np.array(loop, dtype=np.int64))
    return sorted(loops, key=len, reverse=True)


def loop_count(faces: np.ndarray) -> int:
    """Number of boundary loops; -1 if the surface is no manifold there."""
    try:
        return len(boundary_loops(faces))
    except ValueError:
        return -1


def face_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (..., F, 3) of triangles on vertices (..., V, 3); zero where the area is."""
    a, b, c = (np.take(vertices, corner, axis=-2) for corner in triangles.T)
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-20)


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3): means of the faces' normals, weighted by area."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], cross)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)


def barycentric(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(P, 3) shares of the corners (P, 3, 3) of triangles in points (P, 3) on them."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, ab, bb = (np.einsum("pi,pi->p", u, v) for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = np.einsum("pi,pi->p", p, a), np.einsum("pi,pi->p", p, b)
    area = np.maximum(aa * bb - ab**2, _SLIVER_M2**2)
    second, third = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    shares = np.clip(np.stack([1 - second - third, second, third], axis=1), 0, 1)
    return shares / shares.sum(axis=1, keepdims=True)


def cross_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products of rows (M, 3), several times as fast as NumPy's for short arrays."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def split_at_seams(mesh: Mesh) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Vertices split where one has several texture coordinates, for a single index per corner.

    Returns:
        The mesh's vertex (V',) and the texture coordinates (V', 2), or None, of each split vertex,
        and the triangles (F, 3) between split vertices.
    """
    if mesh.uv is None or mesh.uv_faces is None:
        return np.arange(len(mesh.vertices)), None, mesh.triangles
    pairs = np.stack([mesh.triangles, triangulate(mesh.uv_faces)], axis=-1).reshape(-1, 2)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    return unique[:, 0], mesh.uv[unique[:, 1]], inverse.reshape(-1, 3)
