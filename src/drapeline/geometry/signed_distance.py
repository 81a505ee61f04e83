"""Signed distances to a closed mesh that is queried many times."""

import igl
import numpy as np

_ON_EDGE = 1e-9  # barycentric coordinates below this count as zero


class SignedDistance:
    """Signed distances to a closed triangle mesh by angle-weighted pseudonormals.

    After Baerentzen and Aanaes (2005), as libigl's `signed_distance`, which would index the mesh
    anew for every query.

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
        self._edge = edge.reshape(3, -1)  # ids of each face's edges, opposite to its corners

    def query(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distances and the ways out.

        Args:
            points: (P, 3) metres.

        Returns:
            Distances (P,) in metres, negative inside, and unit vectors (P, 3) in which they grow;
            on the surface itself these are the pseudonormals.
        """
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
        zero = shares < _ON_EDGE
        normal = self._of_faces[face]
        edge = np.flatnonzero(zero.sum(axis=1) == 1)
        normal[edge] = self._of_edges[self._edge[zero[edge].argmax(axis=1), face[edge]]]
        vertex = np.flatnonzero(zero.sum(axis=1) == 2)
        normal[vertex] = self._of_vertices[corners[vertex, shares[vertex].argmax(axis=1)]]
        return normal
