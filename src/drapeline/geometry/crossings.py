"""Edges of moving cloth that pass through triangles, decided exactly."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import warp as wp

from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.warp_mesh import move_mesh, warp_mesh

_DEVICE = "cpu"
_OWN = wp.constant(1)  # bits: through a triangle of the edge's own garment
_OTHER = wp.constant(2)  # through one of another garment
# Of a determinant of differences in double precision, by its sum of magnitudes (Shewchuk 1997,
# "Adaptive Precision Floating-Point Arithmetic", section 4.3).
_ROUNDING = wp.constant(wp.float64((7 + 56 * 2.0**-53) * 2.0**-53))


@wp.func
def _side(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    # On which side of the plane through a, b and c the point d is: 1, -1, or 0 where rounding
    # leaves it open.
    u = a - d
    v = b - d
    w = c - d
    vw = v[0] * w[1]
    wv = w[0] * v[1]
    wu = w[0] * u[1]
    uw = u[0] * w[1]
    uv = u[0] * v[1]
    vu = v[0] * u[1]
    volume = u[2] * (vw - wv) + v[2] * (wu - uw) + w[2] * (uv - vu)
    size = (wp.abs(vw) + wp.abs(wv)) * wp.abs(u[2])
    size += (wp.abs(wu) + wp.abs(uw)) * wp.abs(v[2])
    size += (wp.abs(uv) + wp.abs(vu)) * wp.abs(w[2])
    side = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    if volume > _ROUNDING * size:
        side = 1
    if volume < -_ROUNDING * size:
        side = -1
    return side


@wp.func
def _point(points: wp.array[wp.vec3], i: int):
    p = points[i]
    return wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))


@wp.kernel
def _find(
    mesh: wp.uint64,
    pairs: wp.array[wp.vec2i],
    layers: wp.array[int],
    through: wp.array[int],
    open_count: wp.array[int],
    open_pairs: wp.array[wp.vec2i],  # edge and triangle that rounding leaves open
):
    edge = wp.tid()
    points = wp.mesh_get(mesh).points
    corners = wp.mesh_get(mesh).indices
    i = pairs[edge][0]
    j = pairs[edge][1]
    p = _point(points, i)
    q = _point(points, j)
    low = wp.min(points[i], points[j])
    query = wp.mesh_query_aabb(mesh, low, wp.max(points[i], points[j]))
    face = int(0)  # noqa: RUF046, UP018
    found = int(0)  # noqa: RUF046, UP018
    while wp.mesh_query_aabb_next(query, face):
        ia = corners[3 * face]
        ib = corners[3 * face + 1]
        ic = corners[3 * face + 2]
        if ia != i and ib != i and ic != i and ia != j and ib != j and ic != j:
            a = _point(points, ia)
            b = _point(points, ib)
            c = _point(points, ic)
            above = _side(a, b, c, p)
            beneath = _side(a, b, c, q)
            if above * beneath <= 0:
                x = _side(p, q, a, b)
                y = _side(p, q, b, c)
                z = _side(p, q, c, a)
                if x * y >= 0 and y * z >= 0 and z * x >= 0:
                    bit = wp.where(layers[ia] == layers[i], _OWN, _OTHER)
                    if above * beneath < 0 and x * y > 0 and y * z > 0:
                        found = found | bit
                    elif (found & bit) == 0:
                        slot = wp.atomic_add(open_count, 0, 1)
                        if slot < open_pairs.shape[0]:
                            open_pairs[slot] = wp.vec2i(edge, face)
    through[edge] = found


class Crossings:
    """Edges of garments that pass through triangles of the same garment, or of another.

    What an edge touches it passes through, but not the plane that it lies in, nor what it has a
    corner in common with.

    Args:
        vertices: (V, 3) of each garment, metres.
        faces: (F, 4) or (F, 3) of each; a quad (0, 1, 2, 3) is the triangles (0, 1, 2), (0, 2, 3),
            whose common edge is one of the edges.
    """

    def __init__(self, vertices: Sequence[np.ndarray], faces: Sequence[np.ndarray]) -> None:
        sizes = list(map(len, vertices))
        starts = np.concatenate([[0], np.cumsum(sizes)])
        halves = [triangulate(part) + start for part, start in zip(faces, starts[:-1], strict=True)]
        self._triangles = np.concatenate(halves).astype(np.int32)
        self._mesh = warp_mesh(np.concatenate(vertices), self._triangles)
        self._pairs = edges(self._triangles).astype(np.int32)
        self._layers = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
        self._edges = wp.array(self._pairs, dtype=wp.vec2i, device=_DEVICE)
        self._layer_of = wp.array(self._layers, dtype=int, device=_DEVICE)
        self._through = wp.zeros(len(self._pairs), dtype=int, device=_DEVICE)
        self._open_count = wp.zeros(1, dtype=int, device=_DEVICE)
        self._open = wp.zeros(len(self._pairs), dtype=wp.vec2i, device=_DEVICE)
        self.edge_counts = np.bincount(self._layers[self._pairs[:, 0]], minlength=len(sizes))

    def find(self, vertices: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Numbers (G,) of each garment's edges that pass through itself, and through others.

        Args:
            vertices: (V, 3) of each garment, metres; taken as float32.
        """
        own, other = self.edges_through(vertices)
        layer, count = self._layers[self._pairs[:, 0]], len(self.edge_counts)
        return (
            np.bincount(layer[own], minlength=count),
            np.bincount(layer[other], minlength=count),
        )

    def edges_through(self, vertices: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Masks (E,) of the edges that pass through their own garment, and through others."""
        points = np.concatenate(vertices).astype(np.float32)
        move_mesh(self._mesh, points)
        self._open_count.zero_()
        wp.launch(
            _find,
            dim=len(self._edges),
            inputs=[self._mesh.id, self._edges, self._layer_of],
            outputs=[self._through, self._open_count, self._open],
            device=_DEVICE,
        )
        through = self._through.numpy().copy()
        for edge, face in self._open.numpy()[: self._open_count.numpy()[0]].tolist():
            corners = self._triangles[face]
            same = self._layers[corners[0]] == self._layers[self._pairs[edge, 0]]
            if passes_through(points[self._pairs[edge]], points[corners]):
                through[edge] |= _OWN if same else _OTHER
        return (through & _OWN) > 0, (through & _OTHER) > 0


def passes_through(segment: np.ndarray, triangle: np.ndarray) -> bool:
    """Whether a segment (2, 3) meets a triangle (3, 3) in whose plane it does not lie, exactly."""
    p, q, a, b, c = (
        [Fraction(float(x)) for x in point] for point in np.concatenate([segment, triangle])
    )
    above, beneath = _volume(a, b, c, p), _volume(a, b, c, q)
    if above * beneath > 0 or above == beneath == 0:
        return False
    sides = [_volume(p, q, *ends) for ends in ((a, b), (b, c), (c, a))]
    return min(sides) >= 0 or max(sides) <= 0


def _volume(a: list[Fraction], b: list[Fraction], c: list[Fraction], d: list[Fraction]) -> Fraction:
    u, v, w = ([x - y for x, y in zip(point, d, strict=True)] for point in (a, b, c))
    return (
        u[2] * (v[0] * w[1] - w[0] * v[1])
        + v[2] * (w[0] * u[1] - u[0] * w[1])
        + w[2] * (u[0] * v[1] - v[0] * u[1])
    )
