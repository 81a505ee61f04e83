"""Cloth against a moving body: each vertex keeps to the outer side of the point nearest to it.

That point, the vertex's anchor, moves with the body between frames and carries a plane along. It is
searched again where the cloth has slid over the body, so that most searches are saved.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp
from scipy.spatial import KDTree

from drapeline.frames import JOINT_NAMES
from drapeline.simulation.collider import MovingBody

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"
_ARM = ("shoulder", "elbow", "wrist", "hand")
_COVERED = 0.005  # share of a garment's vertices at a segment that it is said to cover
_STICKING = wp.constant(2.0e-5)  # metres of slip per step that friction always holds
_RELEASED = wp.constant(3.0e-4)  # metres of old depth that a step takes away


@wp.kernel
def _sum_face_normals(
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    normals: wp.array(dtype=wp.vec3),
):
    face = faces[wp.tid()]
    a = points[face[0]]
    normal = wp.cross(points[face[1]] - a, points[face[2]] - a)
    wp.atomic_add(normals, face[0], normal)
    wp.atomic_add(normals, face[1], normal)
    wp.atomic_add(normals, face[2], normal)


@wp.kernel
def _make_unit(normals: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    normals[i] = wp.normalize(normals[i])


@wp.kernel
def _move_surface(
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    clock: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    points[i] = start[i] + (end[i] - start[i]) * clock[0]


@wp.func
def _blend(values: wp.array(dtype=wp.vec3), face: wp.vec3i, weights: wp.vec3):
    return (
        values[face[0]] * weights[0] + values[face[1]] * weights[1] + values[face[2]] * weights[2]
    )


@wp.func
def _face_normal(points: wp.array(dtype=wp.vec3), face: wp.vec3i):
    a = points[face[0]]
    return wp.cross(points[face[1]] - a, points[face[2]] - a)


@wp.kernel
def _find_anchors(
    meshes: wp.array2d(dtype=wp.uint64),  # of each garment: what it lies on, other limbs
    first_face: wp.array2d(dtype=int),
    face_numbers: wp.array(dtype=int),
    layers: wp.array(dtype=int),
    faces: wp.array(dtype=wp.vec3i),
    points: wp.array(dtype=wp.vec3),
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    start_normals: wp.array(dtype=wp.vec3),
    end_normals: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
    reach: float,
    gap: float,
    slack: float,
    # The anchor: its face or -1, weights of the corners, and the way from it to the vertex.
    anchor: wp.array(dtype=int),
    weights: wp.array(dtype=wp.vec3),
    away: wp.array(dtype=wp.vec3),
    # Its place and normal at both ends of the frame.
    from_place: wp.array(dtype=wp.vec3),
    to_place: wp.array(dtype=wp.vec3),
    from_normal: wp.array(dtype=wp.vec3),
    to_normal: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    p = place[i]
    old = anchor[i]
    search = True
    if old >= 0:
        slid = wp.length(p - _blend(points, faces[old], weights[i]) - away[i])
        # Cloth off the body may move by half of its distance before it can touch anything.
        search = slid > wp.max(slack, 0.5 * (wp.length(away[i]) - gap))
    if search:
        anchor[i] = -1
        part = int(0)  # noqa: UP018
        while part < 2 and anchor[i] < 0:
            hit = wp.mesh_query_point_no_sign(meshes[layers[i], part], p, reach)
            if hit.result:
                number = face_numbers[first_face[layers[i], part] + hit.face]
                found = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
                here = _blend(points, faces[number], found)
                normal = _face_normal(points, faces[number])
                keep = False
                if old >= 0 and wp.dot(p - here, normal) < 0.0:
                    # In the body: stay with the side that it came from if another is nearer now.
                    keep = wp.dot(_face_normal(points, faces[old]), normal) < 0.0
                if keep:
                    anchor[i] = old
                else:
                    anchor[i] = number
                    weights[i] = found
                away[i] = p - _blend(points, faces[anchor[i]], weights[i])
            part += 1
    if anchor[i] >= 0:
        face = faces[anchor[i]]
        from_place[i] = _blend(start, face, weights[i])
        to_place[i] = _blend(end, face, weights[i])
        from_normal[i] = _blend(start_normals, face, weights[i])
        to_normal[i] = _blend(end_normals, face, weights[i])


@wp.kernel
def touch_body(
    anchor: wp.array(dtype=int),
    from_place: wp.array(dtype=wp.vec3),
    to_place: wp.array(dtype=wp.vec3),
    from_normal: wp.array(dtype=wp.vec3),
    to_normal: wp.array(dtype=wp.vec3),
    clock: wp.array(dtype=float),
    carry: wp.array(dtype=wp.vec3),
    gap: float,
    friction: wp.array(dtype=float),
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    if anchor[i] < 0:
        return
    way = to_place[i] - from_place[i]
    here = from_place[i] + way * clock[1]
    normal = wp.normalize(from_normal[i] + (to_normal[i] - from_normal[i]) * clock[1])
    p = place[i]
    depth = gap - wp.dot(p - here, normal)
    if depth > 0.0:
        there = from_place[i] + way * clock[0] + carry[0]
        o = before[i]
        # What was deep before the step comes out slowly, and must not become speed.
        old = wp.clamp(gap - wp.dot(o - there, normal), 0.0, depth)
        released = wp.min(old, _RELEASED)
        push = depth - old + released
        p = p + normal * push
        o = o + normal * released
        slip = (p - o) - (here - there)
        slip = slip - normal * wp.dot(slip, normal)
        most = friction[0] * (push - released + _STICKING)
        length = wp.length(slip)
        if length > most:
            slip = slip * (most / length)
        place[i] = p - slip
        before[i] = o


class BodySurface:
    """The body's surface between two frames, and where each vertex of the cloth is nearest to it.

    What a garment lies on goes before limbs that it does not cover: a hand on a thigh touches only
    cloth that is away from the thigh, and none that is caught between the two.

    Args:
        body: what the cloth collides with.
        garments: vertices (V, 3) of each garment in frame 0.
    """

    def __init__(self, body: MovingBody, garments: Sequence[np.ndarray]) -> None:
        vertices, count = body.frame(0), sum(map(len, garments))
        flat = np.ascontiguousarray(body.faces, dtype=np.int32)
        self._faces = wp.array(flat, dtype=wp.vec3i, device=_DEVICE)
        self._start, self._end, self._points = (
            wp.array(vertices.astype(np.float32), dtype=wp.vec3, device=_DEVICE) for _ in range(3)
        )
        self._start_normals, self._end_normals = (wp.zeros_like(self._end) for _ in range(2))
        self._find_normals(self._end, self._end_normals)
        parts = [
            part
            for cloth in garments
            for part in split_faces(vertices, body.faces, body.segments, cloth)
        ]
        self._meshes = [self._index(flat[part]) for part in parts]
        shape = (len(garments), 2)
        ids = np.array([mesh.id for mesh in self._meshes], dtype=np.uint64).reshape(shape)
        first = np.cumsum([0, *map(len, parts)])[:-1].reshape(shape)
        layers = np.repeat(np.arange(len(garments)), [len(cloth) for cloth in garments])
        self._parts = [
            wp.array(ids, dtype=wp.uint64, device=_DEVICE),
            *(
                wp.array(numbers.astype(np.int32), dtype=int, device=_DEVICE)
                for numbers in (first, np.concatenate(parts), layers)
            ),
        ]
        self.anchor = wp.full(count, -1, dtype=int, device=_DEVICE)
        self._weights, self._away = (_vectors(count) for _ in range(2))
        self.from_place, self.to_place, self.from_normal, self.to_normal = (
            _vectors(count) for _ in range(4)
        )

    def _index(self, faces: np.ndarray) -> wp.Mesh:
        """Some of the faces (F', 3) for queries; one far away if there are none."""
        if not len(faces):
            far = wp.array(np.full((3, 3), 1e6, np.float32), dtype=wp.vec3, device=_DEVICE)
            return wp.Mesh(far, wp.array([0, 1, 2], dtype=wp.int32, device=_DEVICE))
        return wp.Mesh(self._points, wp.array(faces.ravel(), dtype=wp.int32, device=_DEVICE))

    def move_to(self, vertices: np.ndarray) -> None:
        """Begin a frame, at whose end the surface is at vertices (B, 3)."""
        self._start, self._end = self._end, self._start
        self._start_normals, self._end_normals = self._end_normals, self._start_normals
        self._end.assign(vertices)
        self._find_normals(self._end, self._end_normals)

    def _find_normals(self, points: wp.array, normals: wp.array) -> None:
        normals.zero_()
        wp.launch(
            _sum_face_normals,
            dim=len(self._faces),
            inputs=[points, self._faces],
            outputs=[normals],
            device=_DEVICE,
        )
        wp.launch(_make_unit, dim=len(points), outputs=[normals], device=_DEVICE)

    def find_anchors(
        self, place: wp.array, clock: wp.array, *, reach_m: float, gap_m: float, slack_m: float
    ) -> None:
        """Find the anchors of cloth at `place` again where it has slid by more than `slack_m`."""
        wp.launch(
            _move_surface,
            dim=len(self._points),
            inputs=[self._start, self._end, clock],
            outputs=[self._points],
            device=_DEVICE,
        )
        for mesh in self._meshes:
            mesh.refit()
        surface = [*self._parts, self._faces, self._points, self._start, self._end]
        wp.launch(
            _find_anchors,
            dim=len(place),
            inputs=[
                *surface,
                *(self._start_normals, self._end_normals, place, reach_m, gap_m, slack_m),
            ],
            outputs=[
                *(self.anchor, self._weights, self._away),
                *(self.from_place, self.to_place, self.from_normal, self.to_normal),
            ],
            device=_DEVICE,
        )


def split_faces(
    vertices: np.ndarray, faces: np.ndarray, segments: np.ndarray, cloth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the faces that a garment lies on, and of those of arms that it does not cover.

    Args:
        vertices: (B, 3) metres of the body in frame 0.
        faces: (F, 3).
        segments: (B,) the joint that moves each vertex most.
        cloth: (V, 3) the garment in frame 0.
    """
    _, nearest = KDTree(vertices).query(cloth)
    covered = np.bincount(segments[nearest], minlength=len(JOINT_NAMES)) > _COVERED * len(cloth)
    bare = np.array([name.split("_")[-1] in _ARM for name in JOINT_NAMES]) & ~covered
    other = bare[segments[faces]].any(axis=1)
    return np.flatnonzero(~other), np.flatnonzero(other)


def _vectors(count: int) -> wp.array:
    return wp.zeros(count, dtype=wp.vec3, device=_DEVICE)
