"""Body against cloth: vertices of the body stay beneath the triangles that cover them.

The vertices of a triangle keep their distance from the body; between them a curved body may come
through.
"""

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LaneInts, make_patches, repeat_first
from drapeline.simulation.collider import MovingBody
from drapeline.xpbd.cloth_contact import NearTriangles
from drapeline.xpbd.contact import ROUNDED, Moves, held_slip, move
from drapeline.xpbd.lanes import COVER_ASIDE, FACING, SLOTS, SMALLEST_M4, find_covers_in_lanes
from drapeline.xpbd.limbs import hand_numbers

wp.set_module_options({"enable_backward": False})

_MOST = wp.constant(SLOTS)
_FACING = wp.constant(FACING)
_ASIDE = wp.constant(COVER_ASIDE)
_SMALLEST_M4 = wp.constant(SMALLEST_M4)


@wp.func
def _cover(p: wp.vec3, up: wp.vec3, most: float, a: wp.vec3, ab: wp.vec3, ac: wp.vec3):
    # Where the line along `up` meets a triangle that faces the same way: how far above p, weights
    # of b and c, and 1; the last is 0 for a triangle that faces another way or is farther than
    # `most`.
    normal = wp.cross(ab, ac)
    slope = wp.dot(up, normal)
    rise = wp.dot(a - p, normal)
    # Most cloth is higher above the body, which is found without a division.
    if slope <= 0.0 or rise > ROUNDED * most * slope:
        return wp.vec4(0.0, 0.0, 0.0, 0.0)
    square = wp.length_sq(normal)
    if slope < _FACING * wp.sqrt(square) or square < _SMALLEST_M4:
        return wp.vec4(0.0, 0.0, 0.0, 0.0)
    height = rise / slope
    r = p + up * height - a
    u = wp.dot(wp.cross(r, ac), normal) / square
    v = wp.dot(wp.cross(ab, r), normal) / square
    return wp.vec4(height, u, v, 1.0)


@wp.kernel
def find_covers_one_per_thread(
    tree: wp.uint64,
    place: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    vertices: wp.array[int],
    start: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    margin: float,
    count: wp.array[int],
    covers: wp.array2d[int],
):
    """Find the triangles that are over each vertex of the body."""
    i = wp.tid()
    p = start[vertices[i]]
    n = normals[vertices[i]]
    half = wp.vec3(margin, margin, margin)
    query = wp.bvh_query_aabb(tree, p - half, p + half)
    face = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    found = int(0)  # noqa: RUF046, UP018
    while wp.bvh_query_next(query, face):
        for k in range(halves):
            c = triangles[halves * face + k]
            a = place[c[0]]
            hit = _cover(p, n, margin, a, place[c[1]] - a, place[c[2]] - a)
            near = hit[3] > 0.0 and wp.abs(hit[0]) < margin and found < _MOST
            if near and wp.min(hit[1], hit[2]) > -_ASIDE and hit[1] + hit[2] < 1.0 + _ASIDE:
                covers[i, found] = halves * face + k
                found += 1
    count[i] = found


@wp.kernel
def _stand(
    vertices: wp.array[int],
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    from_place: wp.array[wp.vec3],
    to_place: wp.array[wp.vec3],
    up: wp.array[wp.vec3],
):
    """Places of some vertices of the body at both ends of a frame, and their normals."""
    i = wp.tid()
    from_place[i] = start[vertices[i]]
    to_place[i] = end[vertices[i]]
    up[i] = normals[vertices[i]]


@wp.kernel
def push_off_body_vertices(
    busy: wp.array[int],  # which of the body's vertices are covered
    count: wp.array[int],
    covers: wp.array2d[int],
    from_place: wp.array[wp.vec3],
    to_place: wp.array[wp.vec3],
    up: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    inverse_mass: wp.array[float],
    clock: wp.array[float],
    carry: wp.array[wp.vec3],
    gap: float,
    reach: float,
    release: float,
    stick: float,
    friction: wp.array[float],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Lift triangles that are less than the gap above a vertex of the body, or beneath it.

    They stick to it or slide (Coulomb).
    """
    i = busy[wp.tid()]
    way = to_place[i] - from_place[i]
    p = from_place[i] + way * clock[1]
    o = from_place[i] + way * clock[0] + carry[0]
    n = up[i]
    for k in range(count[i]):
        c = triangles[covers[i, k]]
        a = place[c[0]]
        hit = _cover(p, n, gap, a, place[c[1]] - a, place[c[2]] - a)
        u = hit[1]
        v = hit[2]
        w = 1.0 - u - v
        depth = gap - hit[0]
        if hit[3] > 0.0 and depth > 0.0 and hit[0] > -reach and u > 0.0 and v > 0.0 and w > 0.0:
            then = before[c[0]] * w + before[c[1]] * u + before[c[2]] * v
            # What was too low before the step is lifted slowly, and must not become speed.
            old = wp.clamp(gap - wp.dot(then - o, n), 0.0, depth)
            released = wp.min(old, release)
            wa = inverse_mass[c[0]] * w
            wb = inverse_mass[c[1]] * u
            wc = inverse_mass[c[2]] * v
            share = 1.0 / (wa * w + wb * u + wc * v)
            push = depth - old + released
            most = friction[c[0]] * (push - released + stick)
            slip = held_slip((p + n * hit[0] - then) - (p - o), n, most)
            shift = (n * push - slip) * share
            lift = n * (released * share)
            move(moves, place, before, c[0], w, a, shift * wa, lift * wa)
            move(moves, place, before, c[1], u, place[c[1]], shift * wb, lift * wb)
            move(moves, place, before, c[2], v, place[c[2]], shift * wc, lift * wc)


class CoveredVertices:
    """Triangles of the cloth over each vertex of the body, hands left out.

    Args:
        body: its vertices (B, 3) at first; those without a face are left out.
        cloth: whose faces cover them.
        parallel: whether each vertex is looked up by itself, as on a GPU, not in patches.
    """

    def __init__(self, body: MovingBody, cloth: NearTriangles, *, parallel: bool = False) -> None:
        segments, faces = body.segments, body.faces
        self._cloth = cloth
        used = np.unique(faces)
        chosen = used[hand_numbers(used[:, None], segments) == 0].astype(np.int32)
        self._vertices = wp.array(chosen, dtype=int)
        self._kernel, self._searches, self._patches = find_covers_one_per_thread, len(chosen), []
        if not parallel:
            patches = make_patches(body.frame(0)[chosen], segments[chosen])
            self._kernel, self._searches = find_covers_in_lanes, len(patches)
            self._patches = [
                wp.array(repeat_first(patches), dtype=LaneInts),
                wp.array((patches >= 0).sum(axis=1), dtype=int),
            ]
        self.count = wp.zeros(len(chosen), dtype=int)
        self.covers = wp.zeros((len(chosen), SLOTS), dtype=int)
        self.from_place, self.to_place, self.up = (
            wp.zeros(len(chosen), dtype=wp.vec3) for _ in range(3)
        )

    def find(
        self, place: wp.array, body: tuple[wp.array, wp.array, wp.array], *, margin_m: float
    ) -> None:
        """Find them for a frame that begins.

        Args:
            place: (V, 3) of the cloth, whose triangles were found there.
            body: vertices (B, 3) at both ends of the frame, and their normals.
            margin_m: how far above or beneath a vertex a triangle may be.
        """
        start, _, normals = body
        cloth, tree = self._cloth, self._cloth.tree
        boxes = [*self._patches, wp.uint64(tree.id)]
        if self._patches:
            boxes += [tree.lowers, tree.uppers]
        wp.launch(
            self._kernel,
            dim=self._searches,
            inputs=[
                *(*boxes, place, cloth.triangles, cloth.halves),
                *(self._vertices, start, normals, margin_m),
            ],
            outputs=[self.count, self.covers],
        )
        wp.launch(
            _stand,
            dim=len(self.count),
            inputs=[self._vertices, *body],
            outputs=[self.from_place, self.to_place, self.up],
        )
