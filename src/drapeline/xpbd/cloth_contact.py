"""Cloth against cloth: vertices keep to the side of the triangles that they are on."""

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LaneFloats, LaneInts, lay_in_lanes, make_patches, repeat_first
from drapeline.xpbd.contact import Moves, held_slip, move, narrowed
from drapeline.xpbd.lanes import ASIDE, SMALLEST_M4, find_near_in_lanes

wp.set_module_options({"enable_backward": False})

_SLOTS = 24  # triangles that a vertex may be near to
_MOST = wp.constant(_SLOTS)
_ASIDE = wp.constant(ASIDE)
_SMALLEST_M4 = wp.constant(SMALLEST_M4)
_ROUNDED = 1.001  # so that corners are within a box's radius, whatever is rounded


@wp.kernel
def _box_faces(
    place: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
):
    # The halves of a quad share a box, which saves half of the tree.
    face = wp.tid()
    corners = triangles[halves * face]
    a = place[corners[0]]
    b = place[corners[1]]
    c = place[corners[2]]
    d = place[triangles[halves * face + halves - 1][2]]
    lower[face] = wp.min(wp.min(a, b), wp.min(c, d))
    upper[face] = wp.max(wp.max(a, b), wp.max(c, d))


@wp.func
def _side(p: wp.vec3, place: wp.array[wp.vec3], c: wp.vec3i, margin: float):
    # Of a triangle that p is near to: 1 above it, -1 beneath it; 0 if it is not near.
    a = place[c[0]]
    ab = place[c[1]] - a
    ac = place[c[2]] - a
    normal = wp.cross(ab, ac)
    square = wp.length_sq(normal)
    height = wp.dot(p - a, normal)
    side = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    if height * height < margin * margin * square and square > _SMALLEST_M4:
        bb = wp.dot(ab, ab)
        cc = wp.dot(ac, ac)
        bc = wp.dot(ab, ac)
        pb = wp.dot(p - a, ab)
        pc = wp.dot(p - a, ac)
        u = (cc * pb - bc * pc) / square
        v = (bb * pc - bc * pb) / square
        if u > -_ASIDE and v > -_ASIDE and u + v < 1.0 + _ASIDE:
            side = 1
            if height < 0.0:
                side = -1
    return side


@wp.kernel
def find_near_one_per_thread(
    rest: wp.array[wp.vec3],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    rest_centres: wp.array[wp.vec3],
    rest_radii: wp.array[float],
    place: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    layers: wp.array[int],
    margin: float,
    free: float,
    count: wp.array[int],
    near: wp.array2d[int],  # number of the triangle + 1, negative beneath it; 0 for none
):
    """Find the triangles that each vertex is near to, and on which side of them it is."""
    i = wp.tid()
    p = place[i]
    half = wp.vec3(margin, margin, margin)
    found = int(0)  # noqa: RUF046, UP018
    query = wp.bvh_query_aabb(tree, p - half, p + half)
    face = int(0)  # noqa: RUF046, UP018
    while wp.bvh_query_next(query, face):
        # Parts of a garment that are close at rest are held apart by the cloth itself; a face's
        # own corners always are, however large it is.
        held = wp.max(free, rest_radii[face])
        apart = wp.length_sq(rest[i] - rest_centres[face]) > held * held
        if apart or layers[triangles[halves * face][0]] != layers[i]:
            for k in range(halves):
                number = halves * face + k
                side = _side(p, place, triangles[number], margin)
                if side != 0 and found < _MOST:
                    near[i, found] = side * (number + 1)
                    found += 1
    count[i] = found


@wp.kernel
def _sum_relative_ways(
    count: wp.array[int],
    near: wp.array2d[int],
    triangles: wp.array[wp.vec3i],
    last: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    sums: wp.array[wp.vec2],  # number of pairs, and squares of their ways past each other
):
    i = wp.tid()
    total = wp.vec2()
    way = place[i] - last[i]
    for k in range(count[i]):
        if near[i, k] != 0:
            corner = triangles[wp.abs(near[i, k]) - 1][0]
            total += wp.vec2(1.0, wp.length_sq(way - place[corner] + last[corner]))
    sums[i] = total


@wp.kernel
def touch_cloth(
    busy: wp.array[int],  # numbers of the vertices that are near to any
    count: wp.array[int],
    near: wp.array2d[int],
    triangles: wp.array[wp.vec3i],
    layers: wp.array[int],
    inverse_mass: wp.array[float],
    clearance: wp.array[wp.vec2],
    own_gap: float,
    layer_gap: float,
    release: float,
    friction: wp.array[float],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Push vertices and triangles apart that are closer than the gap, with friction."""
    i = busy[wp.tid()]
    for k in range(count[i]):
        number = near[i, k]
        if number == 0:
            continue
        side = float(1.0)  # noqa: UP018
        if number < 0:
            side = -1.0
        c = triangles[wp.abs(number) - 1]
        p = place[i]
        a = place[c[0]]
        ab = place[c[1]] - a
        ac = place[c[2]] - a
        normal = wp.cross(ab, ac)
        square = wp.length_sq(normal)
        height = wp.dot(p - a, normal) * side
        gap = own_gap
        if layers[i] != layers[c[0]]:
            gap = layer_gap
        gap = narrowed(gap, clearance[i])
        if (height < 0.0 or height * height < gap * gap * square) and square > 1.0e-18:
            bb = wp.dot(ab, ab)
            cc = wp.dot(ac, ac)
            bc = wp.dot(ab, ac)
            pb = wp.dot(p - a, ab)
            pc = wp.dot(p - a, ac)
            scale = 1.0 / square
            u = (cc * pb - bc * pc) * scale
            v = (bb * pc - bc * pb) * scale
            if u > -0.02 and v > -0.02 and u + v < 1.02:
                t = 1.0 - u - v
                size = wp.sqrt(square)
                up = normal * (side / size)
                depth = gap - height / size
                old_p = before[i]
                old_q = before[c[0]] * t + before[c[1]] * u + before[c[2]] * v
                q = a + ab * u + ac * v
                old = wp.clamp(gap - wp.dot(old_p - old_q, up), 0.0, depth)
                released = wp.min(old, release)
                push = depth - old + released
                slip = held_slip((p - old_p) - (q - old_q), up, friction[i] * (push - released))
                w = inverse_mass[i]
                wa = inverse_mass[c[0]] * t
                wb = inverse_mass[c[1]] * u
                wc = inverse_mass[c[2]] * v
                share = 1.0 / (w + wa * t + wb * u + wc * v)
                shift = (up * push - slip) * share
                lift = up * (released * share)
                move(moves, place, before, i, 1.0, p, shift * w, lift * w)
                move(moves, place, before, c[0], t, a, -(shift * wa), -(lift * wa))
                move(moves, place, before, c[1], u, a + ab, -(shift * wb), -(lift * wb))
                move(moves, place, before, c[2], v, a + ac, -(shift * wc), -(lift * wc))


class NearTriangles:
    """Triangles of the cloth that each of its vertices is near to, and on which side.

    Args:
        rest: (V, 3) vertices at rest.
        triangles: (F, 3); halves of a quad follow one another if `halves` is 2.
        layers: (V,) number of each vertex's garment.
        halves: triangles per face.
        parallel: whether each vertex is looked up by itself, as on a GPU, not in patches.

    Attributes:
        triangles, halves: as given.
        tree: of boxes around the faces, as they were found last.
        count, near: how many triangles each vertex is near to, and their numbers.
    """

    def __init__(
        self,
        rest: wp.array,
        triangles: wp.array,
        layers: wp.array,
        halves: int,
        *,
        parallel: bool = False,
    ) -> None:
        self.triangles, self._layers, self.halves = triangles, layers, halves
        faces = len(triangles) // halves
        self._lower, self._upper = (wp.zeros(faces, dtype=wp.vec3) for _ in range(2))
        self._box(rest)
        self.tree = wp.Bvh(self._lower, self._upper)
        low, high = self._lower.numpy(), self._upper.numpy()
        self._centres = wp.array((low + high) / 2, dtype=wp.vec3)
        self._radii = wp.array(_ROUNDED * np.linalg.norm(high - low, axis=1) / 2, dtype=float)
        if parallel:
            self._kernel, self._searches, self._rest = find_near_one_per_thread, len(rest), [rest]
        else:
            patches = make_patches(rest.numpy(), layers.numpy())
            self._kernel, self._searches = find_near_in_lanes, len(patches)
            self._rest = [
                wp.array(repeat_first(patches), dtype=LaneInts),
                wp.array((patches >= 0).sum(axis=1), dtype=int),
                wp.array(lay_in_lanes(rest.numpy(), patches), dtype=LaneFloats),
            ]
        self._sums = wp.zeros(len(rest), dtype=wp.vec2)
        self.count = wp.zeros(len(rest), dtype=int)
        self.near = wp.zeros((len(rest), _SLOTS), dtype=int)

    def find(self, place: wp.array, *, margin_m: float, free_m: float) -> None:
        """Find them again for cloth at `place`, but for those within `free_m` at rest.

        Nor are a face's own corners near to it, whatever its size.
        """
        self._box(place)
        self.tree.refit()
        wp.launch(
            self._kernel,
            dim=self._searches,
            inputs=[
                *(*self._rest, wp.uint64(self.tree.id), self._lower, self._upper),
                *(self._centres, self._radii, place),
                *(self.triangles, self.halves, self._layers, margin_m, free_m),
            ],
            outputs=[self.count, self.near],
        )

    def relative_way_m(self, last: wp.array, place: wp.array) -> float:
        """Way of vertices past triangles that they are near to, as a root mean square."""
        wp.launch(
            _sum_relative_ways,
            dim=len(place),
            inputs=[self.count, self.near, self.triangles, last, place],
            outputs=[self._sums],
        )
        pairs, squares = self._sums.numpy().sum(axis=0, dtype=np.float64)
        return float(np.sqrt(squares / max(pairs, 1)))

    def _box(self, place: wp.array) -> None:
        wp.launch(
            _box_faces,
            dim=len(self._lower),
            inputs=[place, self.triangles, self.halves],
            outputs=[self._lower, self._upper],
        )
