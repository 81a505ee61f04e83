"""Which vertices of some parts of a body are inside others, for many pairs of parts at once."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from drapeline.bodies.parts import BodyParts
from drapeline.geometry.warp_mesh import start_warp

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"
_NEAR_M = wp.constant(wp.float64(0.06))  # how deep inside a part a vertex is recognised as such
# About an edge: this close to the surface the nearest vertex may lie aside.
_SHALLOW_M = wp.constant(wp.float64(0.015))
_STEEP = wp.constant(wp.float64(0.5))


@wp.func
def _area_vector(points: wp.array(dtype=wp.vec3), face: wp.vec3i):
    a = points[face[0]]
    vector = wp.cross(points[face[1]] - a, points[face[2]] - a)
    return wp.vec3d(wp.float64(vector[0]), wp.float64(vector[1]), wp.float64(vector[2]))


@wp.func
def _way(start: wp.vec3, end: wp.vec3):
    way = end - start
    return wp.vec3d(wp.float64(way[0]), wp.float64(way[1]), wp.float64(way[2]))


@wp.kernel
def _mark_inside(
    points: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    first_face: wp.array(dtype=int),  # of each vertex, in the list of
    face_numbers: wp.array(dtype=int),
    asked: wp.array(dtype=int),
    question: wp.array(dtype=int),
    others: wp.array(dtype=int),
    first_other: wp.array(dtype=int),  # of each question
    inside: wp.array(dtype=int),
):
    i = wp.tid()
    point = points[asked[i]]
    nearest = int(-1)  # noqa: RUF046, UP018
    squared = _NEAR_M * _NEAR_M
    for k in range(first_other[question[i]], first_other[question[i] + 1]):
        way = _way(points[others[k]], point)
        length = wp.dot(way, way)
        if length < squared:
            squared = length
            nearest = others[k]
    if nearest < 0:
        inside[i] = 0
        return
    normal = wp.vec3d()
    for k in range(first_face[nearest], first_face[nearest + 1]):
        normal += _area_vector(before, faces[face_numbers[k]])
    height = wp.dot(_way(points[nearest], point), wp.normalize(normal))
    distance = wp.sqrt(squared)
    # Deep inside, the nearest vertex lies straight above; beside it, only where a part ends.
    steep = distance < _SHALLOW_M or height < -_STEEP * distance
    inside[i] = int(height < wp.float64(0.0) and steep)


class InsideParts:
    """Tells which vertices lie behind the nearest ones of other parts.

    Args:
        parts: the body's parts.
    """

    def __init__(self, parts: BodyParts) -> None:
        start_warp()
        count = parts.faces_of.shape[0]
        self._points, self._before = (
            wp.zeros(count, dtype=wp.vec3, device=_DEVICE) for _ in range(2)
        )
        faces, first, numbers = (
            wp.array(np.ascontiguousarray(x, dtype=np.int32), dtype=kind, device=_DEVICE)
            for x, kind in (
                (parts.faces, wp.vec3i),
                (parts.faces_of.indptr, int),
                (parts.faces_of.indices, int),
            )
        )
        self._body = [self._points, self._before, faces, first, numbers]
        self._reserve(1)

    def _reserve(self, size: int) -> None:
        """Make room for as many vertices, others and questions; new arrays take their time."""
        self._size = size
        self._asked, self._question, self._others, self._first, self._inside = (
            wp.zeros(size + 1, dtype=int, device=_DEVICE) for _ in range(5)
        )
        self._launch = wp.launch(
            _mark_inside,
            dim=1,
            inputs=[*self._body, self._asked, self._question, self._others, self._first],
            outputs=[self._inside],
            device=_DEVICE,
            record_cmd=True,
        )

    def __call__(
        self,
        vertices: np.ndarray,
        before: np.ndarray,
        questions: Sequence[tuple[np.ndarray, np.ndarray]],
    ) -> list[np.ndarray]:
        """Those of some vertices that lie behind the nearest of others, for each question.

        Args:
            vertices: (V, 3) float32, metres.
            before: (V, 3) float32, whose normals count.
            questions: ids (n,) of vertices, and ids (m,) of the others.
        """
        asked, others = ([q[side] for q in questions] for side in (0, 1))
        counts = [len(ids) for ids in asked]
        total = sum(counts)
        if not total:
            return asked
        first = np.cumsum([0, *map(len, others)])
        needed = max(total, len(questions), int(first[-1]))
        if needed > self._size:
            self._reserve(2 * needed)
        self._points.numpy()[:] = vertices
        self._before.numpy()[:] = before
        self._asked.numpy()[:total] = np.concatenate(asked)
        self._question.numpy()[:total] = np.repeat(np.arange(len(questions)), counts)
        self._others.numpy()[: first[-1]] = np.concatenate(others)
        self._first.numpy()[: len(first)] = first
        self._launch.set_dim(total)
        self._launch.launch()
        marked = np.split(self._inside.numpy()[:total] > 0, np.cumsum(counts)[:-1])
        return [ids[mark] for ids, mark in zip(asked, marked, strict=True)]
