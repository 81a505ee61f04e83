"""Which edges of a mesh pass through its own triangles."""

import numpy as np
import warp as wp

from drapeline.geometry.mesh import edges
from drapeline.geometry.warp_mesh import move_mesh, warp_mesh

_DEVICE = "cpu"


@wp.kernel
def _find_crossing(
    mesh: wp.uint64,
    pairs: wp.array(dtype=wp.vec2i),
    crossing: wp.array(dtype=int),
):
    edge = wp.tid()
    points = wp.mesh_get(mesh).points
    corners = wp.mesh_get(mesh).indices
    i = pairs[edge][0]
    j = pairs[edge][1]
    p = points[i]
    way = points[j] - p
    query = wp.mesh_query_aabb(mesh, wp.min(p, points[j]), wp.max(p, points[j]))
    face = int(0)  # noqa: RUF046, UP018
    while wp.mesh_query_aabb_next(query, face):
        a = corners[3 * face]
        b = corners[3 * face + 1]
        c = corners[3 * face + 2]
        if a != i and b != i and c != i and a != j and b != j and c != j:
            # Moeller and Trumbore (1997), in double precision: cloth is nearly flat.
            start = wp.vec3d(p - points[a])
            along = wp.vec3d(way)
            one = wp.vec3d(points[b] - points[a])
            two = wp.vec3d(points[c] - points[a])
            side = wp.cross(along, two)
            size = wp.dot(one, side)
            if wp.abs(size) > wp.float64(1.0e-18):
                u = wp.dot(start, side) / size
                other = wp.cross(start, one)
                v = wp.dot(along, other) / size
                t = wp.dot(two, other) / size
                zero = wp.float64(0.0)
                unit = wp.float64(1.0)
                if u >= zero and v >= zero and u + v <= unit and t > zero and t < unit:
                    crossing[edge] = 1


class SelfCrossings:
    """Counts the edges of a moving triangle mesh that pass through its own triangles.

    Args:
        vertices: (V, 3), in the first shape.
        triangles: (F, 3).
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._mesh = warp_mesh(vertices, triangles)
        pairs = edges(triangles).astype(np.int32)
        self._edges = wp.array(pairs, dtype=wp.vec2i, device=_DEVICE)
        self._crossing = wp.zeros(len(pairs), dtype=int, device=_DEVICE)

    def share(self, vertices: np.ndarray) -> float:
        """Share of the edges that pass through one of the other triangles at `vertices` (V, 3)."""
        move_mesh(self._mesh, vertices)
        self._crossing.zero_()
        wp.launch(
            _find_crossing,
            dim=len(self._edges),
            inputs=[self._mesh.id, self._edges],
            outputs=[self._crossing],
            device=_DEVICE,
        )
        return float(self._crossing.numpy().mean())
