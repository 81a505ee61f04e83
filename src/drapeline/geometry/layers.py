"""Which points lie beneath a sheet, such as an outer garment's vertices beneath an inner one."""

import numpy as np
import warp as wp

from drapeline.geometry.warp_mesh import move_mesh, warp_mesh

_DEVICE = "cpu"
_STRAIGHT = wp.constant(0.5)


@wp.kernel
def _sum_face_normals(mesh: wp.uint64, normals: wp.array(dtype=wp.vec3)):
    face = wp.tid()
    points = wp.mesh_get(mesh).points
    corners = wp.mesh_get(mesh).indices
    a = points[corners[3 * face]]
    normal = wp.cross(points[corners[3 * face + 1]] - a, points[corners[3 * face + 2]] - a)
    for k in range(3):
        wp.atomic_add(normals, corners[3 * face + k], normal)


@wp.kernel
def _find_beneath(
    mesh: wp.uint64,
    normals: wp.array(dtype=wp.vec3),
    points: wp.array(dtype=wp.vec3),
    reach: float,
    beneath: wp.array(dtype=int),
):
    index = wp.tid()
    point = points[index]
    hit = wp.mesh_query_point_no_sign(mesh, point, reach)
    if hit.result:
        away = point - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v)
        corners = wp.mesh_get(mesh).indices
        normal = wp.vec3(0.0, 0.0, 0.0)
        for k in range(3):
            normal += wp.normalize(normals[corners[3 * hit.face + k]]) / 3.0
        # A point that is nearest to the sheet's open edge is past it, not beneath it.
        if wp.dot(away, normal) < -_STRAIGHT * wp.length(away):
            beneath[index] = 1


class MovingSheet:
    """An open surface of fixed faces that moves, indexed once.

    Args:
        vertices: (V, 3) metres, in the first frame.
        faces: (F, 3) outward.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._mesh, self._faces = warp_mesh(vertices, faces), len(faces)
        self._normals = wp.zeros(len(vertices), dtype=wp.vec3, device=_DEVICE)

    def move(self, vertices: np.ndarray) -> None:
        """Take another shape: vertices (V, 3) in metres."""
        move_mesh(self._mesh, vertices)

    def beneath(self, points: np.ndarray, reach_m: float) -> np.ndarray:
        """Which points (P, 3) are beneath it (P,), and no farther from it than `reach_m`."""
        self._normals.zero_()
        wp.launch(
            _sum_face_normals,
            dim=self._faces,
            inputs=[self._mesh.id],
            outputs=[self._normals],
            device=_DEVICE,
        )
        beneath = wp.zeros(len(points), dtype=int, device=_DEVICE)
        places = wp.array(points.astype(np.float32), dtype=wp.vec3, device=_DEVICE)
        wp.launch(
            _find_beneath,
            dim=len(points),
            inputs=[self._mesh.id, self._normals, places, reach_m],
            outputs=[beneath],
            device=_DEVICE,
        )
        return beneath.numpy() > 0
