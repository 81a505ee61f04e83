"""Cloth against cloth: edges keep to the side of other edges that they are on."""

import numpy as np
import warp as wp

from drapeline.geometry.mesh import face_edges
from drapeline.xpbd.contact import narrowed
from drapeline.xpbd.moves import Moves, move

wp.set_module_options({"enable_backward": False})

_SLOTS = 10  # edges that an edge may be near to
_MOST = wp.constant(_SLOTS)


@wp.func
def _nearest_on_lines(p: wp.vec3, d: wp.vec3, q: wp.vec3, e: wp.vec3):
    # Where lines p + s d and q + t e are closest; (-1, -1) if they are nearly parallel.
    dd = wp.dot(d, d)
    ee = wp.dot(e, e)
    de = wp.dot(d, e)
    r = p - q
    square = dd * ee - de * de
    if square < 1.0e-3 * dd * ee:
        return wp.vec2(-1.0, -1.0)
    rd = wp.dot(r, d)
    re = wp.dot(r, e)
    return wp.vec2((de * re - ee * rd) / square, (dd * re - de * rd) / square)


@wp.kernel
def _find_near_edges(
    place: wp.array(dtype=wp.vec3),
    edges: wp.array(dtype=wp.vec2i),
    triangle_edges: wp.array(dtype=wp.vec3i),
    near_count: wp.array(dtype=int),
    near: wp.array2d(dtype=int),
    crossings: wp.array(dtype=int),
    margin: float,
    count: wp.array(dtype=int),
    pairs: wp.array2d(dtype=int),  # number of the other edge + 1, negative on the other side
):
    edge = wp.tid()
    count[edge] = 0
    ends = edges[edge]
    if crossings[edge] > 0 or near_count[ends[0]] + near_count[ends[1]] == 0:
        return
    p = place[ends[0]]
    d = place[ends[1]] - p
    found = int(0)  # noqa: RUF046, UP018
    for k in range(near_count[ends[0]] + near_count[ends[1]]):
        number = int(0)  # noqa: RUF046, UP018
        if k < near_count[ends[0]]:
            number = near[ends[0], k]
        else:
            number = near[ends[1], k - near_count[ends[0]]]
        if number == 0:
            continue
        sides = triangle_edges[wp.abs(number) - 1]
        for m in range(3):
            other = sides[m]
            new = other >= 0 and found < _MOST
            if new:
                new = crossings[other] == 0
            for n in range(found):
                if wp.abs(pairs[edge, n]) == other + 1:
                    new = False
            if new:
                far = edges[other]
                if (
                    far[0] != ends[0]
                    and far[0] != ends[1]
                    and far[1] != ends[0]
                    and far[1] != ends[1]
                ):
                    q = place[far[0]]
                    e = place[far[1]] - q
                    at = _nearest_on_lines(p, d, q, e)
                    if at[0] > -0.2 and at[0] < 1.2 and at[1] > -0.2 and at[1] < 1.2:
                        way = p + d * at[0] - q - e * at[1]
                        if wp.length_sq(way) < margin * margin:
                            if wp.dot(way, wp.cross(d, e)) < 0.0:
                                pairs[edge, found] = -(other + 1)
                            else:
                                pairs[edge, found] = other + 1
                            found += 1
    count[edge] = found


@wp.kernel
def touch_edges(
    busy: wp.array(dtype=int),  # numbers of the edges that are near to any
    count: wp.array(dtype=int),
    pairs: wp.array2d(dtype=int),
    edges: wp.array(dtype=wp.vec2i),
    layers: wp.array(dtype=int),
    inverse_mass: wp.array(dtype=float),
    room: wp.array(dtype=wp.vec2),
    own_gap: float,
    layer_gap: float,
    release: float,
    moves: Moves,
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    """Push edges apart that are closer than the gap."""
    edge = busy[wp.tid()]
    ends = edges[edge]
    i = ends[0]
    j = ends[1]
    for k in range(count[edge]):
        number = pairs[edge, k]
        side = float(1.0)  # noqa: UP018
        if number < 0:
            side = -1.0
        far = edges[wp.abs(number) - 1]
        a = far[0]
        b = far[1]
        p = place[i]
        d = place[j] - p
        q = place[a]
        e = place[b] - q
        gap = own_gap
        if layers[i] != layers[a]:
            gap = layer_gap
        # Vertices so close to one another have much the same room.
        gap = narrowed(gap, room[i])
        normal = wp.cross(d, e)
        square = wp.length_sq(normal)
        height = wp.dot(p - q, normal) * side
        # Most pairs are too far apart to touch, which their lines tell without a division.
        if height < 0.0 or height * height < gap * gap * square:
            at = _nearest_on_lines(p, d, q, e)
            s = at[0]
            t = at[1]
            if s > 0.0 and s < 1.0 and t > 0.0 and t < 1.0:
                up = normal * (side / wp.sqrt(square))
                depth = gap - height / wp.sqrt(square)
                old_p = before[i] * (1.0 - s) + before[j] * s
                old_q = before[a] * (1.0 - t) + before[b] * t
                old = wp.clamp(gap - wp.dot(old_p - old_q, up), 0.0, depth)
                released = wp.min(old, release)
                wi = inverse_mass[i] * (1.0 - s)
                wj = inverse_mass[j] * s
                wa = inverse_mass[a] * (1.0 - t)
                wb = inverse_mass[b] * t
                share = 1.0 / (wi * (1.0 - s) + wj * s + wa * (1.0 - t) + wb * t)
                shift = up * ((depth - old + released) * share)
                lift = up * (released * share)
                move(moves, place, before, i, 1.0 - s, p, shift * wi, lift * wi)
                move(moves, place, before, j, s, p + d, shift * wj, lift * wj)
                move(moves, place, before, a, 1.0 - t, q, -(shift * wa), -(lift * wa))
                move(moves, place, before, b, t, q + e, -(shift * wb), -(lift * wb))


class NearEdges:
    """Which other edges each edge of the cloth is near to, and on which side.

    Args:
        edges: (E, 2) of the cloth, without diagonals.
        triangle_edges: (F, 3) number of each triangle's edges, -1 for a diagonal.
    """

    def __init__(self, edges: wp.array, triangle_edges: wp.array) -> None:
        self._edges, self._triangle_edges = edges, triangle_edges
        self.count = wp.zeros(len(edges), dtype=int)
        self.pairs = wp.zeros((len(edges), _SLOTS), dtype=int)

    def find(
        self,
        place: wp.array,
        near_count: wp.array,
        near: wp.array,
        crossings: wp.array,
        *,
        margin_m: float,
    ) -> None:
        """Find them again among the edges of the triangles that the ends of an edge are near to.

        Edges that pass through a triangle have no side, and are left out.

        Args:
            place: (V, 3) vertices.
            near_count, near: of `NearTriangles`.
            crossings: (E,) number of triangles that an edge passes through.
            margin_m: how far apart they may be.
        """
        cloth = [place, self._edges, self._triangle_edges, near_count, near, crossings]
        wp.launch(
            _find_near_edges,
            dim=len(self._edges),
            inputs=[*cloth, margin_m],
            outputs=[self.count, self.pairs],
        )


def edges_of_triangles(pairs: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which of the edges `pairs` (E, 2), in lexical order, triangles have: (F, 3), -1 for none."""
    all_pairs, which = face_edges(triangles)
    base = int(triangles.max()) + 1
    known, wanted = (p[:, 0].astype(np.int64) * base + p[:, 1] for p in (pairs, all_pairs))
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    number = np.where(known[place] == wanted, place, -1)
    return number[which].astype(np.int32)
