"""Edges of moving cloth that pass through triangles, decided exactly."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LaneInts, make_patches, near_code, repeat_first
from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.warp_mesh import start_warp

_DEVICE = "cpu"
# Whether an edge passes through a triangle.
_THROUGH = wp.constant(1)
_UNSURE = wp.constant(2)  # rounding leaves it open
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
def _box_triangles(
    points: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
):
    face = wp.tid()
    corners = triangles[face]
    a = points[corners[0]]
    b = points[corners[1]]
    c = points[corners[2]]
    lower[face] = wp.min(a, wp.min(b, c))
    upper[face] = wp.max(a, wp.max(b, c))


# Triangles whose boxes meet those of edges of a patch, and that have no corner in common with them.
_FIND_CLOSE = """
const int* ends = (const int*)edges.data;
lanes end_x, end_y, end_z;
masks first, second;
for (int k = 0; k < 8; ++k) {
    first[k] = ends[2 * which[k]];
    second[k] = ends[2 * which[k] + 1];
    const wp::vec3 end = points.data[second[k]];
    low = wp::min(low, end);
    high = wp::max(high, end);
    end_x[k] = end[0];
    end_y[k] = end[1];
    end_z[k] = end[2];
}
auto lesser = [](lanes a, lanes b) { return __builtin_elementwise_min(a, b); };
auto greater = [](lanes a, lanes b) { return __builtin_elementwise_max(a, b); };
const lanes low_x = lesser(x, end_x), low_y = lesser(y, end_y), low_z = lesser(z, end_z);
const lanes high_x = greater(x, end_x), high_y = greater(y, end_y), high_z = greater(z, end_z);
const int room = close.shape[0];
int found = close_count.data[0];
auto look = [&](int face) {
    const wp::vec3 from = lower.data[face], to = upper.data[face];
    masks here = (high_x >= from[0]) & (low_x <= to[0]) & (high_y >= from[1]) & (low_y <= to[1]);
    here &= (high_z >= from[2]) & (low_z <= to[2]);
    if (!any(here))
        return;
    const int* corners = (const int*)triangles.data + 3 * face;
    for (int k = 0; k < 3; ++k)
        here &= (first != corners[k]) & (second != corners[k]);
    if (!any(here))
        return;
    for (int k = 0; k < size; ++k)
        if (here[k]) {
            if (found < room)
                close.data[found] = wp::vec_t<2, int>(which[k], face);
            ++found;
        }
};
descend(look);
close_count.data[0] = found;
"""


@wp.func_native(near_code("points.data[((const int*)edges.data)[2 * number]]", _FIND_CLOSE))
def _find_close(
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    patches: wp.array[LaneInts],
    patch: int,
    sizes: wp.array[int],
    edges: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    margin: float,
    close_count: wp.array[int],
    close: wp.array[wp.vec2i],
): ...


@wp.kernel
def _find_close_in_lanes(
    patches: wp.array[LaneInts],  # edges; empty lanes repeat the first
    sizes: wp.array[int],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    margin: float,
    close_count: wp.array[int],
    close: wp.array[wp.vec2i],  # edge and triangle
):
    _find_close(
        tree,
        lower,
        upper,
        patches,
        wp.tid(),
        sizes,
        edges,
        triangles,
        points,
        margin,
        close_count,
        close,
    )


@wp.kernel
def _decide(
    close: wp.array[wp.vec2i],
    points: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    decided: wp.array[int],
):
    pair = wp.tid()
    ends = edges[close[pair][0]]
    corners = triangles[close[pair][1]]
    p = _point(points, ends[0])
    q = _point(points, ends[1])
    a = _point(points, corners[0])
    b = _point(points, corners[1])
    c = _point(points, corners[2])
    decided[pair] = 0
    above = _side(a, b, c, p)
    beneath = _side(a, b, c, q)
    if above * beneath <= 0:
        x = _side(p, q, a, b)
        y = _side(p, q, b, c)
        z = _side(p, q, c, a)
        if x * y >= 0 and y * z >= 0 and z * x >= 0:
            sure = above * beneath < 0 and x * y > 0 and y * z > 0
            decided[pair] = wp.where(sure, _THROUGH, _UNSURE)


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
        start_warp()
        points = np.concatenate(vertices).astype(np.float32)
        self._triangles = np.concatenate(halves).astype(np.int32)
        self._pairs = edges(self._triangles).astype(np.int32)
        self._layers = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
        patches = make_patches(points[self._pairs].mean(axis=1), self._layers[self._pairs[:, 0]])
        self._points, self._faces, self._edges, self._patches, self._sizes = (
            wp.array(values, dtype=kind, device=_DEVICE)
            for values, kind in (
                (points, wp.vec3),
                (self._triangles, wp.vec3i),
                (self._pairs, wp.vec2i),
                (repeat_first(patches), LaneInts),
                ((patches >= 0).sum(axis=1), int),
            )
        )
        self._lower, self._upper = (
            wp.zeros(len(self._triangles), dtype=wp.vec3, device=_DEVICE) for _ in range(2)
        )
        self._box()
        self._tree = wp.Bvh(self._lower, self._upper)
        self._close_count = wp.zeros(1, dtype=int, device=_DEVICE)
        self._expect(len(self._pairs))
        self.edge_counts = np.bincount(self._layers[self._pairs[:, 0]], minlength=len(sizes))

    def _expect(self, count: int) -> None:
        """Make room for so many edges that are close to a triangle."""
        self._close = wp.zeros(count, dtype=wp.vec2i, device=_DEVICE)
        self._decided = wp.zeros(count, dtype=int, device=_DEVICE)

    def _box(self) -> None:
        wp.launch(
            _box_triangles,
            dim=len(self._faces),
            inputs=[self._points, self._faces],
            outputs=[self._lower, self._upper],
            device=_DEVICE,
        )

    def _find_close(self) -> int:
        """Number of pairs of an edge and a triangle whose boxes meet."""
        self._close_count.zero_()
        wp.launch(
            _find_close_in_lanes,
            dim=len(self._patches),
            inputs=[
                *(self._patches, self._sizes, wp.uint64(self._tree.id), self._lower, self._upper),
                *(self._edges, self._faces, self._points, 0.0),
            ],
            outputs=[self._close_count, self._close],
            device=_DEVICE,
        )
        return int(self._close_count.numpy()[0])

    def find(self, vertices: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Numbers (G,) of each garment's edges that pass through itself, and through others.

        Args:
            vertices: (V, 3) of each garment, metres; taken as float32.
        """
        pairs = self.pairs_through(vertices)
        layer = self._layers[self._pairs[pairs[:, 0], 0]]
        own = layer == self._layers[self._triangles[pairs[:, 1], 0]]
        count = len(self.edge_counts)
        first, second = (
            np.bincount(self._layers[self._pairs[np.unique(pairs[side, 0]), 0]], minlength=count)
            for side in (own, ~own)
        )
        return first, second

    def pairs_through(self, vertices: Sequence[np.ndarray]) -> np.ndarray:
        """(n, 2) numbers of edges and of the triangles that they pass through.

        Edges are those of all garments' triangles in the order of `mesh.edges`.

        Args:
            vertices: as for `find`.
        """
        points = np.concatenate(vertices).astype(np.float32)
        self._points.assign(points)
        self._box()
        self._tree.refit()
        count = self._find_close()
        if count > len(self._close):
            self._expect(2 * count)
            self._find_close()
        wp.launch(
            _decide,
            dim=count,
            inputs=[self._close, self._points, self._edges, self._faces],
            outputs=[self._decided],
            device=_DEVICE,
        )
        decided, close = self._decided.numpy()[:count], self._close.numpy()[:count]
        through = decided == int(_THROUGH)
        for pair in np.flatnonzero(decided == int(_UNSURE)):
            edge, face = close[pair]
            through[pair] = passes_through(points[self._pairs[edge]], points[self._triangles[face]])
        return close[through]

    def corners(self, pairs: np.ndarray) -> np.ndarray:
        """Vertices (m,), counted through all garments, of edges and triangles (n, 2)."""
        edge, face = pairs.T
        return np.union1d(self._pairs[edge], self._triangles[face])


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
