"""Cloth against cloth: edges keep to their side of other edges, and what crosses is pulled out."""

import numpy as np
import warp as wp

from drapeline.geometry.mesh import face_edges
from drapeline.xpbd.contact import Moves, move, narrowed

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
    place: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    triangle_edges: wp.array[wp.vec3i],
    near_count: wp.array[int],
    near: wp.array2d[int],
    crossings: wp.array[int],
    margin: float,
    count: wp.array[int],
    pairs: wp.array2d[int],  # number of the other edge + 1, negative on the other side
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
    busy: wp.array[int],  # numbers of the edges that are near to any
    count: wp.array[int],
    pairs: wp.array2d[int],
    edges: wp.array[wp.vec2i],
    layers: wp.array[int],
    inverse_mass: wp.array[float],
    clearance: wp.array[wp.vec2],
    own_gap: float,
    layer_gap: float,
    release: float,
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
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
        gap = narrowed(gap, clearance[i])
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
    """Other edges that each edge (E, 2), no diagonal, of cloth is near to, and on which side.

    `triangle_edges` (F, 3) are the numbers of each triangle's edges, -1 for a diagonal.
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
    """Numbers (F, 3) of triangles' edges among `pairs` (E, 2) in lexical order, -1 for none."""
    all_pairs, which = face_edges(triangles)
    base = int(triangles.max()) + 1
    known, wanted = (p[:, 0].astype(np.int64) * base + p[:, 1] for p in (pairs, all_pairs))
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    number = np.where(known[place] == wanted, place, -1)
    return number[which].astype(np.int32)


_CROSSED_SLOTS = 3  # triangles that an edge may pass through
_MOST_CROSSED = wp.constant(_CROSSED_SLOTS)
_LEAST_SLOPE = wp.constant(0.1)  # sine of the angle between an edge and what it passes through


@wp.func
def _hit(p: wp.vec3, d: wp.vec3, a: wp.vec3, ab: wp.vec3, ac: wp.vec3):
    # Where p + t d passes through a triangle: t, and weights of b and c; t is -1 if it does not.
    normal = wp.cross(ab, ac)
    slope = wp.dot(d, normal)
    if wp.abs(slope) < 1.0e-14:
        return wp.vec3(-1.0, 0.0, 0.0)
    t = wp.dot(a - p, normal) / slope
    if t < 0.0 or t > 1.0:
        return wp.vec3(-1.0, 0.0, 0.0)
    r = p + d * t - a
    square = wp.length_sq(normal)
    u = wp.dot(wp.cross(r, ac), normal) / square
    v = wp.dot(wp.cross(ab, r), normal) / square
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return wp.vec3(-1.0, 0.0, 0.0)
    return wp.vec3(t, u, v)


@wp.kernel
def _find_crossings(
    place: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    near_count: wp.array[int],
    near: wp.array2d[int],
    count: wp.array[int],
    crossed: wp.array2d[int],
):
    edge = wp.tid()
    ends = edges[edge]
    p = place[ends[0]]
    d = place[ends[1]] - p
    found = int(0)  # noqa: RUF046, UP018
    for k in range(near_count[ends[0]] + near_count[ends[1]]):
        number = int(0)  # noqa: RUF046, UP018
        if k < near_count[ends[0]]:
            number = wp.abs(near[ends[0], k]) - 1
        else:
            number = wp.abs(near[ends[1], k - near_count[ends[0]]]) - 1
        c = triangles[number]
        new = found < _MOST_CROSSED and c[0] != ends[0] and c[1] != ends[0] and c[2] != ends[0]
        if c[0] == ends[1] or c[1] == ends[1] or c[2] == ends[1]:
            new = False
        for n in range(found):
            if crossed[edge, n] == number:
                new = False
        if new:
            a = place[c[0]]
            if _hit(p, d, a, place[c[1]] - a, place[c[2]] - a)[0] >= 0.0:
                crossed[edge, found] = number
                found += 1
    count[edge] = found


@wp.kernel
def _free_crossed(
    edges: wp.array[wp.vec2i],
    count: wp.array[int],
    crossed: wp.array2d[int],
    near_count: wp.array[int],
    near: wp.array2d[int],
):
    # The ends of an edge that passes through a triangle are on no side of it.
    edge = wp.tid()
    for k in range(count[edge]):
        for end in range(2):
            vertex = edges[edge][end]
            for n in range(near_count[vertex]):
                if wp.abs(near[vertex, n]) - 1 == crossed[edge, k]:
                    near[vertex, n] = 0


@wp.func
def _along(p: wp.vec3, e: wp.vec3, n: wp.vec3, opposite: wp.vec3):
    # The way, of length 1, in which a triangle beside an edge through p along e, whose third
    # corner is given, passes through a plane with normal n.
    inwards = opposite - p - e * wp.dot(opposite - p, e)
    way = wp.normalize(wp.cross(n, wp.cross(e, inwards)))
    if wp.dot(way, inwards) < 0.0:
        way = -way
    return way


@wp.kernel
def untangle(
    busy: wp.array[int],  # numbers of the edges that pass through any
    count: wp.array[int],
    crossed: wp.array2d[int],
    edges: wp.array[wp.vec2i],
    opposite: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    inverse_mass: wp.array[float],
    step: float,
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Move edges and the triangles that they pass through so that the intersection shrinks.

    Volino and Magnenat-Thalmann 2006, "Resolving Surface Collisions through Intersection Contour
    Minimization", equation 3. It gives no speed.
    """
    edge = busy[wp.tid()]
    for k in range(count[edge]):
        i = edges[edge][0]
        j = edges[edge][1]
        c = triangles[crossed[edge, k]]
        p = place[i]
        d = place[j] - p
        a = place[c[0]]
        ab = place[c[1]] - a
        ac = place[c[2]] - a
        hit = _hit(p, d, a, ab, ac)
        if hit[0] >= 0.0:
            e = wp.normalize(d)
            n = wp.normalize(wp.cross(ab, ac))
            slope = wp.dot(e, n)
            ways = wp.vec3(0.0, 0.0, 0.0)
            for side in range(2):
                other = opposite[edge][side]
                if other >= 0:
                    ways += _along(p, e, n, place[other])
            if wp.abs(slope) < _LEAST_SLOPE:
                slope = wp.sign(slope) * _LEAST_SLOPE
            shift = ways - n * (2.0 * wp.dot(e, ways) / slope)
            shift = shift * (step / wp.sqrt(wp.length_sq(shift) + 1.0))
            s = hit[0]
            u = hit[1]
            v = hit[2]
            w = 1.0 - u - v
            wi = inverse_mass[i] * (1.0 - s)
            wj = inverse_mass[j] * s
            wa = inverse_mass[c[0]] * w
            wb = inverse_mass[c[1]] * u
            wc = inverse_mass[c[2]] * v
            shift = shift / (wi * (1.0 - s) + wj * s + wa * w + wb * u + wc * v)
            move(moves, place, before, i, 1.0 - s, p, shift * wi, shift * wi)
            move(moves, place, before, j, s, p + d, shift * wj, shift * wj)
            move(moves, place, before, c[0], w, a, -(shift * wa), -(shift * wa))
            move(moves, place, before, c[1], u, a + ab, -(shift * wb), -(shift * wb))
            move(moves, place, before, c[2], v, a + ac, -(shift * wc), -(shift * wc))


class Crossings:
    """Triangles (F, 3) of the cloth that its edges (E, 2), no diagonals, pass through."""

    def __init__(self, edges: wp.array, triangles: wp.array) -> None:
        self._edges, self._triangles = edges, triangles
        self.count = wp.zeros(len(edges), dtype=int)
        self.crossed = wp.zeros((len(edges), _CROSSED_SLOTS), dtype=int)

    def find(self, place: wp.array, near_count: wp.array, near: wp.array) -> None:
        """Find them again, among the triangles that the ends of an edge are near to.

        These lose what their edges pass through.

        Args:
            place: (V, 3) vertices.
            near_count, near: of `NearTriangles`.
        """
        wp.launch(
            _find_crossings,
            dim=len(self._edges),
            inputs=[place, self._edges, self._triangles, near_count, near],
            outputs=[self.count, self.crossed],
        )
        wp.launch(
            _free_crossed,
            dim=len(self._edges),
            inputs=[self._edges, self.count, self.crossed],
            outputs=[near_count, near],
        )


def opposite_vertices(pairs: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Third corners (E, 2) of the triangles beside each of the edges `pairs` (E, 2); -1 for none.

    Edges are in lexical order and belong to one or two triangles (F, 3).
    """
    sides = edges_of_triangles(pairs, triangles)
    opposite = np.full((len(pairs), 2), -1, dtype=np.int32)
    corners = np.roll(triangles, 1, axis=1)  # opposite to the edge from each corner to the next
    order = np.argsort(sides.ravel(), kind="stable")
    edge, corner = sides.ravel()[order], corners.ravel()[order]
    edge, corner = edge[edge >= 0], corner[edge >= 0]
    again = np.concatenate([[False], edge[1:] == edge[:-1]])
    opposite[edge[~again], 0] = corner[~again]
    opposite[edge[again], 1] = corner[again]
    return opposite
