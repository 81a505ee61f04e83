"""How far points are outside of a body, asked for many times."""

import igl
import numpy as np

_ON_EDGE = 1e-9  # barycentric coordinate that counts as none


class SignedDistance:
    """A closed triangle mesh: signed distances by angle-weighted pseudonormals.

    After Baerentzen and Aanaes (2005), as libigl's `signed_distance`, which indexes the mesh
    anew for every question.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3), outward.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)
        self._of_faces = igl.per_face_normals(self._vertices, self._faces, np.zeros(3))
        self._of_vertices = igl.per_vertex_normals(
            self._vertices, self._faces, igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_ANGLE
        )
        self._of_edges, _, edge = igl.per_edge_normals(
            self._vertices, self._faces, igl.PER_EDGE_NORMALS_WEIGHTING_TYPE_UNIFORM
        )
        self._edge = edge.reshape(3, -1)  # of each face, opposite to its corners

    def outside(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (P,) of points (P, 3), negative inside, and the unit way out (P, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        squared, face, nearest = self._tree.squared_distance(self._vertices, self._faces, points)
        normal = self._pseudonormal(nearest, face)
        away = points - nearest
        sign = np.where(np.einsum("pi,pi->p", away, normal) < 0, -1.0, 1.0)
        length = np.sqrt(squared)
        way = np.where(
            length[:, None] > 1e-5, away * (sign / np.maximum(length, 1e-12))[:, None], normal
        )
        return sign * length, way

    def _pseudonormal(self, places: np.ndarray, face: np.ndarray) -> np.ndarray:
        """(P, 3) unit normals at places on faces, on edges and at vertices."""
        corners = self._faces[face]
        shares = igl.barycentric_coordinates(
            places, *(self._vertices[corners[:, i]] for i in range(3))
        )
        none = shares < _ON_EDGE
        normal = self._of_faces[face]
        edge = np.flatnonzero(none.sum(axis=1) == 1)
        normal[edge] = self._of_edges[self._edge[none[edge].argmax(axis=1), face[edge]]]
        vertex = np.flatnonzero(none.sum(axis=1) == 2)
        normal[vertex] = self._of_vertices[corners[vertex, shares[vertex].argmax(axis=1)]]
        return normal
