"""Common ground of all contacts: release of old depth, friction, floor, and moves of vertices.

Contacts move vertices one after the other on a processor, all at once on a GPU.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Where the body faces itself, in a crease or beneath an arm, there are two sheets of cloth. They
# divide the room between them and the body, rather than press each other into it.
SHARE_OF_CLEARANCE = wp.constant(1.0 / 3.0)
ROUNDED = wp.constant(1.001)  # so that nothing that is near is too far, whatever is rounded


@wp.func
def held_slip(slip: wp.vec3, up: wp.vec3, most: float):
    """Part of a slip past a surface that friction takes back: along it, and `most` at most."""
    along = slip - up * wp.dot(slip, up)
    length = wp.length(along)
    if length > most:
        along = along * (most / length)
    return along


@wp.func
def pushed_out(
    p: wp.vec3,
    o: wp.vec3,
    way: wp.vec3,
    normal: wp.vec3,
    depth: float,
    old: float,
    release: float,
    friction: float,
    stick: float,
):
    """A vertex that is pushed out of a surface, where it sticks or slides (Coulomb).

    Args:
        p, o: where it is, and where it was before the step.
        way: that the surface goes in the step.
        normal: of the surface.
        depth: of the vertex, more than 0.
        old: part of it that was there before the step, which comes out slowly, and does not become
            speed.
        release: of old depth that a step takes away.
        friction: coefficient.
        stick: of slip that friction holds in a step however light the contact is.
    """
    released = wp.min(old, release)
    push = depth - old + released
    p = p + normal * push
    o = o + normal * released
    most = friction * (push - released + stick)
    return p - held_slip((p - o) - way, normal, most), o


@wp.func
def narrowed(gap: float, clearance: wp.vec2):
    """Gap that is left between sheets where the body faces itself at a frame's two ends."""
    return wp.min(gap, SHARE_OF_CLEARANCE * wp.min(clearance[0], clearance[1]))


@wp.kernel
def touch_floor(
    height: wp.array[wp.vec2],  # at both ends of the frame
    clock: wp.array[float],
    carry: wp.array[wp.vec3],
    gap: float,
    release: float,
    stick: float,
    friction: wp.array[float],
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Keep vertices above the floor."""
    i = wp.tid()
    rise = height[0][1] - height[0][0]
    start = height[0][0] + rise * clock[0] + gap
    end = height[0][0] + rise * clock[1] + gap
    p = place[i]
    o = before[i]
    depth = end - p[2]
    if depth > 0.0:
        old = wp.clamp(start + carry[0][2] - o[2], 0.0, depth)
        way = wp.vec3(0.0, 0.0, end - start) - carry[0]
        up = wp.vec3(0.0, 0.0, 1.0)
        out, then = pushed_out(p, o, way, up, depth, old, release, friction[i], stick)
        place[i] = out
        before[i] = then


# Whole numbers add up to the same whatever their order, and with them two runs to the same bytes.
_PER_M = wp.constant(float(2**40))
_PER_WEIGHT = wp.constant(float(2**16))


@wp.struct
class Moves:
    """Sums of what contacts do that act at once; without vertices where they act in turn.

    Attributes:
        place, before: (V, 3) of the ways of each vertex, and of the place that it came from.
        weight: (V,) of the shares that vertices have in contacts.
    """

    place: wp.array2d[wp.int64]
    before: wp.array2d[wp.int64]
    weight: wp.array[int]


def make_moves(count: int) -> Moves:
    """No moves of so many vertices; of none for contacts that act in turn."""
    moves = Moves()
    moves.place, moves.before = (wp.zeros((count, 3), dtype=wp.int64) for _ in range(2))
    moves.weight = wp.zeros(count, dtype=int)
    return moves


@wp.func
def _add(sums: wp.array2d[wp.int64], i: int, way: wp.vec3):
    for axis in range(3):
        wp.atomic_add(sums, i, axis, wp.int64(way[axis] * _PER_M))


@wp.func
def move(
    moves: Moves,
    place: wp.array[wp.vec3],
    before: wp.array[wp.vec3],
    i: int,
    weight: float,
    start: wp.vec3,
    way: wp.vec3,
    lift: wp.vec3,
):
    """Move a vertex, and the place that it came from, for a contact.

    Args:
        moves: where to add it up, if that is to be.
        i: the vertex, which is at `start` now.
        weight: its share in its side of the contact, 1 for a vertex that touches a triangle.
        way, lift: of the vertex, and of the place that it came from.
    """
    if moves.weight.shape[0] == 0:
        place[i] = start + way
        before[i] = before[i] + lift
    else:
        _add(moves.place, i, way)
        _add(moves.before, i, lift)
        wp.atomic_add(moves.weight, i, int(wp.abs(weight) * _PER_WEIGHT))


@wp.struct
class Near:
    """What each vertex, or edge, is near to.

    Attributes:
        count: (N,) of them; the rest is of each of all of them.
        other: (N, K) their numbers.
        room_m: (N, K) how far from it they are at rest, at least; much if of another garment.
        due: (N, K) the small step of the frame from which it may touch them.
        soon: (N,) the least of these.
    """

    count: wp.array[int]
    other: wp.array2d[int]
    room_m: wp.array2d[float]
    due: wp.array2d[int]
    soon: wp.array[int]


@wp.struct
class Meetings:
    """Those of them that it may touch in a small step, as they are when it begins.

    Attributes:
        count, other: as of `Near`.
        way: (N, K) direction from the other's closest point, and the gap that is to be kept.
        at: (N, K) weights of the closest points, and how far apart they are.
    """

    count: wp.array[int]
    other: wp.array2d[int]
    way: wp.array2d[wp.vec4]
    at: wp.array2d[wp.vec4]


def make_near(count: int, slots: int) -> Near:
    """Nothing near to so many things; room for `slots` each."""
    near = Near()
    near.count, near.soon = (wp.zeros(count, dtype=int) for _ in range(2))
    near.other, near.due = (wp.zeros((count, slots), dtype=int) for _ in range(2))
    near.room_m = wp.zeros((count, slots), dtype=float)
    return near


def make_meetings(count: int, slots: int) -> Meetings:
    """No meetings of so many things; room for `slots` each."""
    meetings = Meetings()
    meetings.count = wp.zeros(count, dtype=int)
    meetings.other = wp.zeros((count, slots), dtype=int)
    meetings.way, meetings.at = (wp.zeros((count, slots), dtype=wp.vec4) for _ in range(2))
    return meetings


# Of their distance at rest, how far apart parts of a garment are kept at most.
ROOM_SHARE = wp.constant(0.4)
# How far apart all cloth stays, if it was: it is published in half precision.
KEPT_M = wp.constant(0.001)
# How fast things come closer in a small step: as fast as they do, half as much again, and this.
_FASTER = wp.constant(1.5)
_SLOWEST_M = wp.constant(0.0006)
_MOST_STEPS = wp.constant(4)  # until they are looked at again
NEVER = wp.constant(1 << 30)


@wp.func
def small_step(clock: wp.array[float], steps: int):
    """Number of a frame's small step, from 1."""
    return int(clock[1] * float(steps) + 0.5)


@wp.func
def nearing(away: float, step_s: float):
    """How far, at most, things come closer in a small step that go apart at a speed, or closer."""
    return wp.max(-away, 0.0) * _FASTER * step_s + _SLOWEST_M


@wp.func
def next_due(now: int, above: float, pace: float):
    """The small step in which to look at things again that are so far above the gap."""
    return now + wp.clamp(int(above / pace) - 1, 1, _MOST_STEPS)


@wp.func
def least_distance(now: float):
    """How far two things must stay apart in a small step that begins with them so far apart."""
    return wp.min(0.9 * now, wp.max(0.1 * now, KEPT_M))


@wp.kernel
def make_all_moves(moves: Moves, before: wp.array[wp.vec3], place: wp.array[wp.vec3]):
    """Make the moves that were added up, and forget them.

    All of them would take a vertex too far that several contacts push at once, and their mean, as
    usual, not far enough for folds that touch: twice as many edges crossed. So the sum is divided
    by the root of the shares in them, which leaves as few crossings as contacts in turn; what a
    contact takes from one side it then does not quite give to the other.
    """
    i = wp.tid()
    weight = moves.weight[i]
    if weight == 0:
        return
    share = 1.0 / (wp.sqrt(wp.max(1.0, float(weight) / _PER_WEIGHT)) * _PER_M)
    way = wp.vec3()
    lift = wp.vec3()
    for axis in range(3):
        way[axis] = float(moves.place[i, axis]) * share
        lift[axis] = float(moves.before[i, axis]) * share
        moves.place[i, axis] = wp.int64(0)
        moves.before[i, axis] = wp.int64(0)
    moves.weight[i] = 0
    place[i] = place[i] + way
    before[i] = before[i] + lift
