"""Cloth against cloth: vertices keep to the side of the triangles that they are on."""

import numpy as np
import warp as wp

from drapeline.geometry.closest import closest_weights
from drapeline.geometry.lanes import LaneFloats, LaneInts, lay_in_lanes, make_patches, repeat_first
from drapeline.xpbd.contact import (
    NEVER,
    ROOM_SHARE,
    Meetings,
    Moves,
    Near,
    held_slip,
    least_distance,
    make_meetings,
    make_near,
    move,
    narrowed,
    nearing,
    next_due,
    small_step,
)
from drapeline.xpbd.lanes import find_near_in_lanes

wp.set_module_options({"enable_backward": False})

_SLOTS = 64  # triangles that a vertex may be near to
_MEETINGS = 64  # of these, those that it may come to in a step
TOUCHING_M = wp.constant(1.0e-7)  # so far apart, things have no direction
_ROUNDED = 1.001  # so that corners are within a box's radius, whatever is rounded


@wp.kernel
def _look_ahead(
    place: wp.array[wp.vec3],
    speed: wp.array[wp.vec3],
    drift: wp.vec3,
    time_s: float,
    sweep: wp.array[wp.vec3],
    middle: wp.array[wp.vec3],
):
    # Half of the way that each vertex goes until it is looked for again, as seen from the cloth's
    # mean, and its place half-way.
    i = wp.tid()
    sweep[i] = (speed[i] - drift) * (0.5 * time_s)
    middle[i] = place[i] + sweep[i]


@wp.kernel
def _box_faces(
    middle: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],  # mean of the corners', and how much one differs from it
):
    # The halves of a quad share a box, which saves half of the tree. It holds them all the way.
    face = wp.tid()
    corners = triangles[halves * face]
    last = triangles[halves * face + halves - 1][2]
    a = middle[corners[0]]
    b = middle[corners[1]]
    c = middle[corners[2]]
    d = middle[last]
    mean = (sweep[corners[0]] + sweep[corners[1]] + sweep[corners[2]] + sweep[last]) * 0.25
    spread = wp.max(wp.length(sweep[corners[0]] - mean), wp.length(sweep[corners[1]] - mean))
    spread = wp.max(spread, wp.length(sweep[corners[2]] - mean))
    spread = wp.max(spread, wp.length(sweep[last] - mean))
    most = wp.length(mean) + spread
    half = wp.vec3(most, most, most)
    lower[face] = wp.min(wp.min(a, b), wp.min(c, d)) - half
    upper[face] = wp.max(wp.max(a, b), wp.max(c, d)) + half
    sweeps[face] = wp.vec4(mean[0], mean[1], mean[2], spread)


@wp.func
def passing(sweep: wp.vec3, other: wp.vec4):
    """How far, at most, things pass each other by half-way, of which one sweeps as a face does."""
    return wp.length(sweep - wp.vec3(other[0], other[1], other[2])) + other[3]


@wp.func
def _room(p: wp.vec3, centre: wp.vec3, radius: float, same: bool):
    # At least how far a vertex is from a face at rest; much if they belong to two garments.
    room = float(1.0e3)  # noqa: UP018  (a plain number would be a constant)
    if same:
        room = wp.length(p - centre) - radius
    return room


@wp.kernel
def find_near_one_per_thread(
    rest: wp.array[wp.vec3],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    rest_centres: wp.array[wp.vec3],
    rest_radii: wp.array[float],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    triangles: wp.array[wp.vec3i],
    halves: int,
    layers: wp.array[int],
    margin: float,
    share: float,
    near: Near,
):
    """Find the triangles that each vertex is near to, and how far from them it is at rest."""
    i = wp.tid()
    p = place[i]
    far = margin + wp.length(sweep[i])
    half = wp.vec3(far, far, far)
    found = int(0)  # noqa: RUF046, UP018
    query = wp.bvh_query_aabb(tree, p - half, p + half)
    face = int(0)  # noqa: RUF046, UP018
    while wp.bvh_query_next(query, face):
        same = layers[triangles[halves * face][0]] == layers[i]
        room = _room(rest[i], rest_centres[face], rest_radii[face], same)
        past = passing(sweep[i], sweeps[face])
        reach = wp.min(margin + past, share * room)
        for k in range(halves):
            number = halves * face + k
            c = triangles[number]
            a = place[c[0]]
            ab = place[c[1]] - a
            ac = place[c[2]] - a
            normal = wp.cross(ab, ac)
            square = wp.length_sq(normal)
            height = wp.dot(p - a, normal)
            if (
                reach > 0.0
                and height * height < reach * reach * square
                and found < near.other.shape[1]
            ):
                at = closest_weights(p, a, a + ab, a + ac)
                if wp.length_sq(p - a - ab * at[1] - ac * at[2]) < reach * reach:
                    near.other[i, found] = number
                    near.room_m[i, found] = room
                    near.due[i, found] = 0
                    found += 1
    near.count[i] = found
    near.soon[i] = 0


@wp.kernel
def _sum_relative_ways(
    near: Near,
    triangles: wp.array[wp.vec3i],
    last: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    sums: wp.array[wp.vec2],  # number of pairs, and squares of their ways past each other
):
    i = wp.tid()
    total = wp.vec2()
    way = place[i] - last[i]
    for k in range(near.count[i]):
        corner = triangles[near.other[i, k]][0]
        total += wp.vec2(1.0, wp.length_sq(way - place[corner] + last[corner]))
    sums[i] = total


@wp.kernel
def approach_triangles(
    busy: wp.array[int],  # numbers of the vertices that are near to any
    near: Near,
    triangles: wp.array[wp.vec3i],
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
    """Find which of the near triangles each vertex may touch in a small step, and from where."""
    i = busy[wp.tid()]
    meetings.count[i] = 0
    now = small_step(clock, steps)
    if near.soon[i] > now:
        return
    soon = int(NEVER)
    found = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    p = place[i]
    for k in range(near.count[i]):
        number = near.other[i, k]
        if near.due[i, k] <= now:
            c = triangles[number]
            a = place[c[0]]
            ab = place[c[1]] - a
            ac = place[c[2]] - a
            gap = layer_gap
            if layers[i] == layers[c[0]]:
                gap = wp.min(own_gap, ROOM_SHARE * near.room_m[i, k])
            gap = narrowed(gap, clearance[i])
            at = closest_weights(p, a, a + ab, a + ac)
            way = p - a - ab * at[1] - ac * at[2]
            distance = wp.length(way)
            way /= wp.max(distance, TOUCHING_M)
            highest = wp.max(wp.dot(speed[c[0]], way), wp.dot(speed[c[1]], way))
            highest = wp.max(highest, wp.dot(speed[c[2]], way))
            pace = nearing(wp.dot(speed[i], way) - highest, step_s)
            near.due[i, k] = next_due(now, distance - gap, pace)
            close = distance < gap + 2.0 * pace and distance > TOUCHING_M
            if close and found < meetings.other.shape[1]:
                meetings.other[i, found] = number
                meetings.way[i, found] = wp.vec4(way[0], way[1], way[2], gap)
                meetings.at[i, found] = wp.vec4(at[0], at[1], at[2], distance)
                found += 1
        soon = wp.min(soon, near.due[i, k])
    meetings.count[i] = found
    near.soon[i] = soon


@wp.kernel
def touch_cloth(
    busy: wp.array[int],
    meetings: Meetings,
    triangles: wp.array[wp.vec3i],
    inverse_mass: wp.array[float],
    release: float,
    friction: wp.array[float],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Push vertices and triangles apart that are closer than the gap, with friction."""
    i = busy[wp.tid()]
    for k in range(meetings.count[i]):
        c = triangles[meetings.other[i, k]]
        way = meetings.way[i, k]
        up = wp.vec3(way[0], way[1], way[2])
        at = meetings.at[i, k]
        p = place[i]
        q = place[c[0]] * at[0] + place[c[1]] * at[1] + place[c[2]] * at[2]
        depth = way[3] - wp.dot(p - q, up)
        if depth > 0.0:
            old_p = before[i]
            old_q = before[c[0]] * at[0] + before[c[1]] * at[1] + before[c[2]] * at[2]
            old = wp.clamp(way[3] - wp.dot(old_p - old_q, up), 0.0, depth)
            released = wp.min(old, release)
            push = depth - old + released
            slip = held_slip((p - old_p) - (q - old_q), up, friction[i] * (push - released))
            w = inverse_mass[i]
            wa = inverse_mass[c[0]] * at[0]
            wb = inverse_mass[c[1]] * at[1]
            wc = inverse_mass[c[2]] * at[2]
            share = 1.0 / (w + wa * at[0] + wb * at[1] + wc * at[2])
            shift = (up * push - slip) * share
            lift = up * (released * share)
            move(moves, place, before, i, 1.0, p, shift * w, lift * w)
            move(moves, place, before, c[0], at[0], place[c[0]], -(shift * wa), -(lift * wa))
            move(moves, place, before, c[1], at[1], place[c[1]], -(shift * wb), -(lift * wb))
            move(moves, place, before, c[2], at[2], place[c[2]], -(shift * wc), -(lift * wc))


@wp.func
def lower(
    moves: Moves,
    place: wp.array[wp.vec3],
    before: wp.array[wp.vec3],
    i: int,
    height: float,
    most: float,
    up: wp.vec3,
):
    """Take a vertex that is so high along `up` down to what it may be at most."""
    if height > most:
        move(moves, place, before, i, 1.0, place[i], up * (most - height), wp.vec3())


@wp.kernel
def part_triangles(
    busy: wp.array[int],
    meetings: Meetings,
    triangles: wp.array[wp.vec3i],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    parted: wp.array[int],
):
    """Keep a plane between each vertex and the triangles that it meets, and count where it failed.

    Ways in a small step are straight, and the plane between the closest points moves with them:
    what is on its own side at both ends never passes through (after Chen et al. 2025, "Offset
    Geometric Contact", whose bounds, too, are shares of the distance before).
    """
    i = busy[wp.tid()]
    for k in range(meetings.count[i]):
        c = triangles[meetings.other[i, k]]
        way = meetings.way[i, k]
        up = wp.vec3(way[0], way[1], way[2])
        a = wp.dot(place[c[0]], up)
        b = wp.dot(place[c[1]], up)
        d = wp.dot(place[c[2]], up)
        height = wp.dot(place[i], up)
        highest = wp.max(a, wp.max(b, d))
        lacking = least_distance(meetings.at[i, k][3]) - height + highest
        if lacking > 0.0:
            wp.atomic_add(parted, 0, 1)
            half = 0.5 * lacking + TOUCHING_M
            lower(moves, place, before, i, -height, -(height + half), -up)
            lower(moves, place, before, c[0], a, highest - half, up)
            lower(moves, place, before, c[1], b, highest - half, up)
            lower(moves, place, before, c[2], d, highest - half, up)


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
        near: what each vertex is near to.
        meetings: those that it may touch in a small step.
        sweep, middle: (V, 3) half of its way until they are found again, and its place half-way.
        sweeps: (F,) of faces, see `passing`.
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
        self.triangles, self.layers, self.halves = triangles, layers, halves
        faces = len(triangles) // halves
        self._lower, self._upper = (wp.zeros(faces, dtype=wp.vec3) for _ in range(2))
        self.sweeps = wp.zeros(faces, dtype=wp.vec4)
        self.sweep, self.middle = (wp.zeros_like(rest) for _ in range(2))
        self._box(rest, self.sweep, np.zeros(3), 0.0)
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
        self.near = make_near(len(rest), _SLOTS)
        self.meetings = make_meetings(len(rest), _MEETINGS)

    def find(
        self,
        place: wp.array,
        speed: wp.array,
        drift: np.ndarray,
        *,
        time_s: float,
        margin_m: float,
        rest_share: float,
    ) -> None:
        """Find them again for cloth at `place`, no farther than a share of their distance at rest.

        What comes near until they are found again is found as well, if nothing changes its speed.
        A face's own corners are never near to it.

        Args:
            place, speed: (V, 3) metres, and metres per second.
            drift: (3,) speed of the cloth as a whole.
            time_s: until they are found again.
            margin_m: how far they may be.
            rest_share: how far, of their distance at rest.
        """
        self._box(place, speed, drift, time_s)
        self.tree.refit()
        wp.launch(
            self._kernel,
            dim=self._searches,
            inputs=[
                *(*self._rest, wp.uint64(self.tree.id), self._lower, self._upper),
                *(self._centres, self._radii, self.middle, self.sweep, self.sweeps),
                *(self.triangles, self.halves, self.layers, margin_m, rest_share),
            ],
            outputs=[self.near],
        )

    def relative_way_m(self, last: wp.array, place: wp.array) -> float:
        """Way of vertices past triangles that they are near to, as a root mean square."""
        wp.launch(
            _sum_relative_ways,
            dim=len(place),
            inputs=[self.near, self.triangles, last, place],
            outputs=[self._sums],
        )
        pairs, squares = self._sums.numpy().sum(axis=0, dtype=np.float64)
        return float(np.sqrt(squares / max(pairs, 1)))

    def _box(self, place: wp.array, speed: wp.array, drift: np.ndarray, time_s: float) -> None:
        wp.launch(
            _look_ahead,
            dim=len(place),
            inputs=[place, speed, wp.vec3(*map(float, drift)), time_s],
            outputs=[self.sweep, self.middle],
        )
        wp.launch(
            _box_faces,
            dim=len(self._lower),
            inputs=[self.middle, self.sweep, self.triangles, self.halves],
            outputs=[self._lower, self._upper, self.sweeps],
        )
