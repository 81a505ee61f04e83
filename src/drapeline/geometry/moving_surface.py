"""Surfaces that move: how far points are from one, and whether inside or beneath it."""

import numpy as np
import scipy.sparse as sp
import warp as wp
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.lanes import LANES, LaneInts
from drapeline.geometry.mesh import face_edges, half_edges
from drapeline.geometry.surface_lanes import find_closest_in_lanes, rows_in_order, windings_in_lanes
from drapeline.geometry.warp_mesh import move_mesh, warp_mesh

_DEVICE = "cpu"


_STRAIGHT = wp.constant(0.5)


@wp.kernel
def _sum_face_normals(mesh: wp.uint64, normals: wp.array[wp.vec3]):
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
    normals: wp.array[wp.vec3],
    points: wp.array[wp.vec3],
    reach: float,
    beneath: wp.array[int],
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
    """An open surface, (V, 3) metres and faces (F, 3) outward, that moves; it is indexed once."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._mesh, self._faces = warp_mesh(vertices, faces), len(faces)
        self._normals = wp.zeros(len(vertices), dtype=wp.vec3, device=_DEVICE)

    def move(self, vertices: np.ndarray) -> None:
        """Take another shape: vertices (V, 3) in metres."""
        move_mesh(self._mesh, vertices)

    def beneath(self, points: np.ndarray, reach_m: float) -> np.ndarray:
        """Mask (P,) of the points (P, 3) beneath it, and no farther from it than `reach_m`."""
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


_PAST_M = wp.constant(1.0e-6)


@wp.kernel
def _bound(
    surface: wp.uint64,
    points: wp.array[wp.vec3],
    faces: wp.array[int],  # the place that was closest to each point in the pose before
    weights: wp.array[wp.vec3],
    reaches: wp.array[float],
):
    """Bounds of the points' distances from the surface: no farther than from a place on it."""
    i = wp.tid()
    place = wp.mesh_eval_position(surface, faces[i], weights[i][0], weights[i][1])
    reaches[i] = 1.01 * wp.length(points[i] - place) + _PAST_M


@wp.kernel
def _locate(
    surface: wp.uint64,
    closed: wp.uint64,
    rows: wp.array[LaneInts],
    points: wp.array[wp.vec3],
    faces: wp.array[int],
    weights: wp.array[wp.vec3],
    distance: wp.array[float],
    windings: wp.array[int],
):
    row = wp.tid()
    # Away from the nearest surface: there is seldom another one in that direction.
    way = wp.vec3(1.0e-9, 2.0e-9, 3.0e-9)
    for k in range(LANES):
        i = rows[row][k]
        at = weights[i]
        away = points[i] - wp.mesh_eval_position(surface, faces[i], at[0], at[1])
        distance[i] = wp.length(away)
        way += away
    windings_in_lanes(closed, rows, row, points, wp.normalize(way), windings)


_SKIN_M = wp.constant(1.0e-5)  # above the surface, where a ray from it starts
_FAR_M = wp.constant(1.0e3)


@wp.kernel
def _find_folds(
    surface: wp.uint64,
    chosen: wp.array[int],
    faces: wp.array[int],
    weights: wp.array[wp.vec3],
    reach: float,
    folded: wp.array[int],
):
    index = wp.tid()
    i = chosen[index]
    at = weights[i]
    up = wp.mesh_eval_face_normal(surface, faces[i])
    start = wp.mesh_eval_position(surface, faces[i], at[0], at[1]) + up * _SKIN_M
    hit = wp.mesh_query_ray(surface, start, up, _FAR_M)
    # What meets the surface from behind starts in another part of it.
    folded[index] = int(hit.result and (hit.t < reach or wp.dot(hit.normal, up) > 0.0))


class MovingSurface:
    """A surface of fixed faces, indexed once.

    It may have holes, as where hands were removed, and limbs may overlap: each hole is closed by a
    fan, and a point is inside if rays leave the body more often than they enter it.

    Args:
        vertices: (B, 3) metres, in the first frame.
        faces: (F, 3) outward.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        fans, self._hole, self._rim = _close_holes(faces, len(vertices))
        self._open = self._closed = warp_mesh(vertices, faces)
        if len(fans):
            self._closed = warp_mesh(self._with_centres(vertices), np.concatenate([faces, fans]))
        self._expect(0)

    def _expect(self, count: int) -> None:
        """Make room for so many points."""
        self._rows = rows_in_order(count)
        self._faces, self._windings = (wp.zeros(count, dtype=int, device=_DEVICE) for _ in range(2))
        self._reaches, self._distance = (
            wp.zeros(count, dtype=float, device=_DEVICE) for _ in range(2)
        )
        self._places, self._weights = (
            wp.zeros(count, dtype=wp.vec3, device=_DEVICE) for _ in range(2)
        )

    def _with_centres(self, vertices: np.ndarray) -> np.ndarray:
        """Vertices (B, 3), and the middles of the holes."""
        count = np.bincount(self._hole)
        centres = [np.bincount(self._hole, vertices[self._rim, k]) / count for k in range(3)]
        return np.concatenate([vertices, np.stack(centres, axis=1)]).astype(np.float32)

    def move(self, vertices: np.ndarray) -> None:
        """Take another pose: vertices (B, 3) in metres."""
        move_mesh(self._open, vertices)
        if self._closed is not self._open:
            move_mesh(self._closed, self._with_centres(vertices))

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (P,) of points (P, 3) to the surface in metres, and whether they are inside.

        Fastest for points that follow one another closely, and in the same order in every pose.
        """
        if len(points) != len(self._faces):
            self._expect(len(points))
        self._places.assign(points.astype(np.float32, copy=False))
        surface, places = self._open.id, self._places
        found = [self._faces, self._weights]
        for kernel, count, inputs, outputs in (
            (_bound, len(points), [surface, places, *found], [self._reaches]),
            (
                find_closest_in_lanes,
                len(self._rows),
                [surface, self._rows, places, self._reaches],
                found,
            ),
            (
                _locate,
                len(self._rows),
                [surface, self._closed.id, self._rows, places, *found],
                [self._distance, self._windings],
            ),
        ):
            wp.launch(kernel, dim=count, inputs=inputs, outputs=outputs, device=_DEVICE)
        return self._distance.numpy().copy(), self._windings.numpy() > 0

    def in_folds(self, chosen: np.ndarray, reach_m: float) -> np.ndarray:
        """Whether points were nearest to where the surface faces or overlaps itself.

        Args:
            chosen: (n,) numbers of points that were located last.
            reach_m: how far the surface may be, along its normal, from where it faces itself.
        """
        folded = wp.zeros(len(chosen), dtype=int, device=_DEVICE)
        numbers = wp.array(chosen.astype(np.int32), dtype=int, device=_DEVICE)
        wp.launch(
            _find_folds,
            dim=len(chosen),
            inputs=[self._open.id, numbers, self._faces, self._weights, reach_m],
            outputs=[folded],
            device=_DEVICE,
        )
        return folded.numpy() > 0


def _close_holes(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fans over the holes of a surface of `count` vertices.

    Returns:
        Triangles (R, 3), whose last corners are the middles of the holes, numbered from `count`;
        the hole (R',) of each vertex on a rim, and these vertices (R',).
    """
    half = half_edges(faces)
    _, which = face_edges(faces)
    rim = half[np.bincount(which.ravel())[which.ravel()] == 1]
    if not len(rim):
        return np.zeros((0, 3), faces.dtype), np.zeros(0, int), np.zeros(0, int)
    used, ends = np.unique(rim, return_inverse=True)
    ends = ends.reshape(rim.shape)
    graph = sp.coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(used),) * 2)
    _, hole = connected_components(graph, directed=False)
    middle = count + hole[ends[:, 0]]
    return np.stack([rim[:, 1], rim[:, 0], middle], axis=1), hole, used
