"""Cloth against cloth: edges keep to their side of other edges, and what crosses is pulled out."""

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LaneInts, make_patches, repeat_first
from drapeline.geometry.mesh import face_edges
from drapeline.xpbd.cloth_contact import TOUCHING_M, NearTriangles, lower, passing
from drapeline.xpbd.contact import (
    NEVER,
    ROOM_SHARE,
    Meetings,
    Moves,
    Near,
    least_distance,
    make_meetings,
    make_near,
    move,
    narrowed,
    nearing,
    next_due,
    small_step,
)
from drapeline.xpbd.lanes import find_near_edges_in_lanes

wp.set_module_options({"enable_backward": False})

# How far beside a triangle an edge may pass, as a share of its sides or of the edge's length.
_TOUCH = wp.constant(1.0e-3)
_SLOTS = 96  # edges that an edge may be near to
_MEETINGS = 48  # of these, those that it may come to in a step


@wp.func
def closest_on_edges(r: wp.vec3, d: wp.vec3, e: wp.vec3):
    """How far along two edges, q + r + s d and q + t e, their closest points are (Ericson 2005)."""
    dd = wp.dot(d, d)
    ee = wp.dot(e, e)
    de = wp.dot(d, e)
    rd = wp.dot(r, d)
    re = wp.dot(r, e)
    square = dd * ee - de * de
    s = float(0.0)  # noqa: UP018
    if square > 1.0e-6 * dd * ee:
        s = wp.clamp((de * re - ee * rd) / square, 0.0, 1.0)
    t = (de * s + re) / wp.max(ee, 1.0e-20)
    if t < 0.0:
        t = 0.0
        s = wp.clamp(-rd / wp.max(dd, 1.0e-20), 0.0, 1.0)
    elif t > 1.0:
        t = 1.0
        s = wp.clamp((de - rd) / wp.max(dd, 1.0e-20), 0.0, 1.0)
    return wp.vec2(s, t)


@wp.kernel
def find_near_edges_one_per_thread(
    tree: wp.uint64,
    edges: wp.array[wp.vec2i],
    owned: wp.array2d[int],  # edges of each face that belong to it, -1 for none
    rest: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    layers: wp.array[int],
    margin: float,
    share: float,
    near: Near,
):
    """Find the edges of a higher number that each edge is near to, and their distance at rest."""
    edge = wp.tid()
    ends = edges[edge]
    p = place[ends[0]]
    d = place[ends[1]] - p
    mean = (sweep[ends[0]] + sweep[ends[1]]) * 0.5
    spread = wp.length(sweep[ends[0]] - sweep[ends[1]]) * 0.5
    widest = margin + wp.length(mean) + spread
    half = wp.vec3(widest, widest, widest)
    found = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    query = wp.bvh_query_aabb(tree, wp.min(p, p + d) - half, wp.max(p, p + d) + half)
    face = int(0)  # noqa: RUF046, UP018
    while wp.bvh_query_next(query, face):
        for m in range(owned.shape[1]):
            other = owned[face, m]
            if other > edge and found < near.other.shape[1]:
                far = edges[other]
                meet = far[0] == ends[0] or far[0] == ends[1]
                if far[1] == ends[0] or far[1] == ends[1]:
                    meet = True
                q = place[far[0]]
                e = place[far[1]] - q
                at = closest_on_edges(p - q, d, e)
                way = p + d * at[0] - q - e * at[1]
                room = float(1.0e3)  # noqa: UP018
                if layers[ends[0]] == layers[far[0]]:
                    u = rest[ends[1]] - rest[ends[0]]
                    v = rest[far[1]] - rest[far[0]]
                    w = rest[ends[0]] - rest[far[0]]
                    then = closest_on_edges(w, u, v)
                    room = wp.length(w + u * then[0] - v * then[1])
                past = spread + passing(mean, sweeps[face])
                reach = wp.min(margin + past, share * room)
                if not meet and wp.length_sq(way) < reach * reach:
                    near.other[edge, found] = other
                    near.room_m[edge, found] = room
                    near.due[edge, found] = 0
                    found += 1
    near.count[edge] = found
    near.soon[edge] = 0


@wp.kernel
def approach_edges(
    busy: wp.array[int],  # numbers of the edges that are near to any
    near: Near,
    edges: wp.array[wp.vec2i],
    layers: wp.array[int],
    clearance: wp.array[wp.vec2],
    clock: wp.array[float],
    steps: int,
    step_s: float,
    own_gap: float,
    layer_gap: float,
    speed: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    meetings: Meetings,
):
    """Find which of the near edges each edge may touch in a small step, and from where."""
    edge = busy[wp.tid()]
    meetings.count[edge] = 0
    now = small_step(clock, steps)
    if near.soon[edge] > now:
        return
    soon = int(NEVER)
    found = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    i = edges[edge][0]
    j = edges[edge][1]
    p = place[i]
    d = place[j] - p
    for k in range(near.count[edge]):
        if near.due[edge, k] <= now:
            far = edges[near.other[edge, k]]
            q = place[far[0]]
            e = place[far[1]] - q
            gap = layer_gap
            if layers[i] == layers[far[0]]:
                gap = wp.min(own_gap, ROOM_SHARE * near.room_m[edge, k])
            # Vertices so close to one another have much the same room.
            gap = narrowed(gap, clearance[i])
            at = closest_on_edges(p - q, d, e)
            way = p + d * at[0] - q - e * at[1]
            distance = wp.length(way)
            way /= wp.max(distance, TOUCHING_M)
            away = wp.min(wp.dot(speed[i], way), wp.dot(speed[j], way))
            away -= wp.max(wp.dot(speed[far[0]], way), wp.dot(speed[far[1]], way))
            pace = nearing(away, step_s)
            near.due[edge, k] = next_due(now, distance - gap, pace)
            close = distance < gap + 2.0 * pace and distance > TOUCHING_M
            if close and found < meetings.other.shape[1]:
                meetings.other[edge, found] = near.other[edge, k]
                meetings.way[edge, found] = wp.vec4(way[0], way[1], way[2], gap)
                meetings.at[edge, found] = wp.vec4(at[0], at[1], 0.0, distance)
                found += 1
        soon = wp.min(soon, near.due[edge, k])
    meetings.count[edge] = found
    near.soon[edge] = soon


@wp.kernel
def touch_edges(
    busy: wp.array[int],
    meetings: Meetings,
    edges: wp.array[wp.vec2i],
    inverse_mass: wp.array[float],
    release: float,
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Push edges apart that are closer than the gap."""
    edge = busy[wp.tid()]
    i = edges[edge][0]
    j = edges[edge][1]
    for k in range(meetings.count[edge]):
        a = edges[meetings.other[edge, k]][0]
        b = edges[meetings.other[edge, k]][1]
        way = meetings.way[edge, k]
        up = wp.vec3(way[0], way[1], way[2])
        s = meetings.at[edge, k][0]
        t = meetings.at[edge, k][1]
        p = place[i] * (1.0 - s) + place[j] * s
        q = place[a] * (1.0 - t) + place[b] * t
        depth = way[3] - wp.dot(p - q, up)
        if depth > 0.0:
            old_p = before[i] * (1.0 - s) + before[j] * s
            old_q = before[a] * (1.0 - t) + before[b] * t
            old = wp.clamp(way[3] - wp.dot(old_p - old_q, up), 0.0, depth)
            released = wp.min(old, release)
            wi = inverse_mass[i] * (1.0 - s)
            wj = inverse_mass[j] * s
            wa = inverse_mass[a] * (1.0 - t)
            wb = inverse_mass[b] * t
            share = 1.0 / (wi * (1.0 - s) + wj * s + wa * (1.0 - t) + wb * t)
            shift = up * ((depth - old + released) * share)
            lift = up * (released * share)
            move(moves, place, before, i, 1.0 - s, place[i], shift * wi, lift * wi)
            move(moves, place, before, j, s, place[j], shift * wj, lift * wj)
            move(moves, place, before, a, 1.0 - t, place[a], -(shift * wa), -(lift * wa))
            move(moves, place, before, b, t, place[b], -(shift * wb), -(lift * wb))


@wp.kernel
def part_edges(
    busy: wp.array[int],
    meetings: Meetings,
    edges: wp.array[wp.vec2i],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    parted: wp.array[int],
):
    """Keep a plane between each edge and those that it meets, see `part_triangles`."""
    edge = busy[wp.tid()]
    i = edges[edge][0]
    j = edges[edge][1]
    for k in range(meetings.count[edge]):
        a = edges[meetings.other[edge, k]][0]
        b = edges[meetings.other[edge, k]][1]
        way = meetings.way[edge, k]
        up = wp.vec3(way[0], way[1], way[2])
        x = wp.dot(place[i], up)
        y = wp.dot(place[j], up)
        u = wp.dot(place[a], up)
        v = wp.dot(place[b], up)
        lowest = wp.min(x, y)
        highest = wp.max(u, v)
        lacking = least_distance(meetings.at[edge, k][3]) - lowest + highest
        if lacking > 0.0:
            wp.atomic_add(parted, 0, 1)
            half = 0.5 * lacking + TOUCHING_M
            lower(moves, place, before, i, -x, -(lowest + half), -up)
            lower(moves, place, before, j, -y, -(lowest + half), -up)
            lower(moves, place, before, a, u, highest - half, up)
            lower(moves, place, before, b, v, highest - half, up)


class NearEdges:
    """Other edges that each edge of cloth is near to; each pair is of the lower number.

    Args:
        cloth: its triangles.
        rest: (V, 3) vertices at rest.
        parallel: whether each edge is looked up by itself, as on a GPU, not in patches.

    Attributes:
        edges: (E, 2) of the triangles: a quad's diagonal is an edge of what is published, and may
            fold.
        near: what each edge is near to.
        meetings: those that it may touch in a small step.
    """

    def __init__(self, cloth: NearTriangles, rest: np.ndarray, *, parallel: bool = False) -> None:
        edges, triangle_edges = face_edges(cloth.triangles.numpy())
        self._cloth, count = cloth, len(edges)
        self.edges = wp.array(edges.astype(np.int32), dtype=wp.vec2i)
        self._rest = wp.array(rest, dtype=wp.vec3)
        owned = _owned_edges(triangle_edges.reshape(-1, 3 * cloth.halves), count)
        self._owned = wp.array(owned, dtype=int)
        self._kernel, self._searches, self._patches = find_near_edges_one_per_thread, count, []
        if not parallel:
            layers = cloth.layers.numpy()[edges[:, 0]]
            patches = make_patches(rest[edges].mean(axis=1), layers)
            self._kernel, self._searches = find_near_edges_in_lanes, len(patches)
            self._patches = [
                wp.array(repeat_first(patches), dtype=LaneInts),
                wp.array((patches >= 0).sum(axis=1), dtype=int),
            ]
        self.near = make_near(count, _SLOTS)
        self.meetings = make_meetings(count, _MEETINGS)

    def find(self, *, margin_m: float, rest_share: float) -> None:
        """Find them again, where the cloth's triangles were found last.

        Args:
            margin_m: how far apart they may be.
            rest_share: how far, of their distance at rest.
        """
        cloth = self._cloth
        tree = cloth.tree
        boxes = [tree.lowers, tree.uppers] if self._patches else []
        wp.launch(
            self._kernel,
            dim=self._searches,
            inputs=[
                *(*self._patches, wp.uint64(tree.id), *boxes, self.edges, self._owned),
                *(self._rest, cloth.middle, cloth.sweep, cloth.sweeps),
                *(cloth.layers, margin_m, rest_share),
            ],
            outputs=[self.near],
        )


def _owned_edges(face_edges: np.ndarray, count: int) -> np.ndarray:
    """Those of the edges (F, K) of each face that no face before it has, -1 for the others."""
    flat, places = face_edges.ravel(), np.arange(face_edges.size)
    first = np.full(count, flat.size)
    np.minimum.at(first, flat, places)
    return np.where(first[flat] == places, flat, -1).reshape(face_edges.shape)


_CROSSED_SLOTS = 3  # triangles that an edge may pass through
_LEAST_SLOPE = wp.constant(0.1)  # sine of the angle between an edge and what it passes through


@wp.func
def _hit(p: wp.vec3, d: wp.vec3, a: wp.vec3, ab: wp.vec3, ac: wp.vec3):
    # Where p + t d passes through a triangle, or touches it, within rounding: t, and weights of b
    # and c; t is -1 if it does not.
    normal = wp.cross(ab, ac)
    slope = wp.dot(d, normal)
    if wp.abs(slope) < 1.0e-14:
        return wp.vec3(-1.0, 0.0, 0.0)
    t = wp.dot(a - p, normal) / slope
    if t < -_TOUCH or t > 1.0 + _TOUCH:
        return wp.vec3(-1.0, 0.0, 0.0)
    r = p + d * t - a
    square = wp.length_sq(normal)
    u = wp.dot(wp.cross(r, ac), normal) / square
    v = wp.dot(wp.cross(ab, r), normal) / square
    if u < -_TOUCH or v < -_TOUCH or u + v > 1.0 + _TOUCH:
        return wp.vec3(-1.0, 0.0, 0.0)
    return wp.vec3(wp.clamp(t, 0.0, 1.0), u, v)


@wp.func
def _forget(near: Near, i: int, other: int):
    for k in range(near.count[i]):
        if near.other[i, k] == other:
            near.due[i, k] = NEVER


@wp.kernel
def _free_crossed(
    pairs: wp.array[wp.vec2i],  # an edge and the triangle that it passed through, or -1
    place: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    triangles: wp.array[wp.vec3i],
    sides: wp.array[wp.vec3i],  # edges of each triangle
    beside: wp.array[wp.vec2i],  # triangles beside each edge, or -1
    near: Near,
    near_edges: Near,
):
    # An edge and a triangle that it passes through are on no side of each other, nor are their
    # parts.
    pair = pairs[wp.tid()]
    if pair[0] < 0:
        return
    ends = edges[pair[0]]
    c = triangles[pair[1]]
    p = place[ends[0]]
    a = place[c[0]]
    if _hit(p, place[ends[1]] - p, a, place[c[1]] - a, place[c[2]] - a)[0] < 0.0:
        return
    for end in range(2):
        _forget(near, ends[end], pair[1])
    for k in range(3):
        side = sides[pair[1]][k]
        _forget(near_edges, wp.min(side, pair[0]), wp.max(side, pair[0]))
        for end in range(2):
            _forget(near, c[k], beside[pair[0]][end])


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
    seen: wp.array[wp.vec3],  # where they pass through
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
        p = seen[i]
        d = seen[j] - p
        a = seen[c[0]]
        ab = seen[c[1]] - a
        ac = seen[c[2]] - a
        hit = _hit(p, d, a, ab, ac)
        if hit[0] >= 0.0:
            e = wp.normalize(d)
            n = wp.normalize(wp.cross(ab, ac))
            slope = wp.dot(e, n)
            ways = wp.vec3(0.0, 0.0, 0.0)
            for side in range(2):
                other = opposite[edge][side]
                if other >= 0:
                    ways += _along(p, e, n, seen[other])
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
            move(moves, place, before, i, 1.0 - s, place[i], shift * wi, shift * wi)
            move(moves, place, before, j, s, place[j], shift * wj, shift * wj)
            move(moves, place, before, c[0], w, place[c[0]], -(shift * wa), -(shift * wa))
            move(moves, place, before, c[1], u, place[c[1]], -(shift * wb), -(shift * wb))
            move(moves, place, before, c[2], v, place[c[2]], -(shift * wc), -(shift * wc))


class CrossedTriangles:
    """Triangles (F, 3) of the cloth that its edges (E, 2) passed through when a frame began."""

    def __init__(self, edges: wp.array, triangles: wp.array) -> None:
        self._edges, self._triangles = edges, triangles
        _, sides = face_edges(triangles.numpy())
        beside = np.where((places := _places(sides)) < 0, -1, places // 3)
        self._sides = wp.array(sides.astype(np.int32), dtype=wp.vec3i)
        self._beside = wp.array(beside.astype(np.int32), dtype=wp.vec2i)
        # Of one size, since a GPU repeats launches as they were recorded.
        self._pairs = wp.zeros(len(edges), dtype=wp.vec2i)
        self.count = wp.zeros(len(edges), dtype=int)
        self.crossed = wp.zeros((len(edges), _CROSSED_SLOTS), dtype=int)

    def take(self, pairs: np.ndarray) -> None:
        """Take numbers (n, 2) of edges and triangles, as `Crossings.pairs_through` gives them."""
        pairs = pairs[: len(self._pairs)]
        rows = np.full((len(self._pairs), 2), -1, dtype=np.int32)
        rows[: len(pairs)] = pairs
        self._pairs.assign(rows)
        pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
        slot = np.arange(len(pairs)) - np.searchsorted(pairs[:, 0], pairs[:, 0])
        pairs, slot = pairs[slot < _CROSSED_SLOTS], slot[slot < _CROSSED_SLOTS]
        crossed = np.zeros(self.crossed.shape, dtype=np.int32)
        crossed[pairs[:, 0], slot] = pairs[:, 1]
        self.crossed.assign(crossed)
        self.count.assign(np.bincount(pairs[:, 0], minlength=len(crossed)).astype(np.int32))

    def free(self, place: wp.array, near: Near, near_edges: Near) -> None:
        """Forget that ends of edges are near to what these still pass through.

        Args:
            place: (V, 3) vertices.
            near: of `NearTriangles`.
        """
        wp.launch(
            _free_crossed,
            dim=len(self._pairs),
            inputs=[self._pairs, place, self._edges, self._triangles, self._sides, self._beside],
            outputs=[near, near_edges],
        )


def opposite_vertices(triangles: np.ndarray) -> np.ndarray:
    """Third corners (E, 2) of the triangles beside each of their `edges`; -1 for none.

    An edge belongs to one or two triangles (F, 3).
    """
    corners = np.roll(triangles, 1, axis=1)  # opposite to the edge from each corner to the next
    places = _places(face_edges(triangles)[1])
    return np.where(places < 0, -1, corners.ravel()[places]).astype(np.int32)


def _places(sides: np.ndarray) -> np.ndarray:
    """(E, 2) places of each edge among those (F, 3) of the triangles, flat; -1 for none."""
    order = np.argsort(sides.ravel(), kind="stable")
    edge = sides.ravel()[order]
    again = np.concatenate([[False], edge[1:] == edge[:-1]])
    places = np.full((edge[-1] + 1, 2), -1)
    places[edge[~again], 0] = order[~again]
    places[edge[again], 1] = order[again]
    return places
