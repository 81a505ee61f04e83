"""What all contacts share: how old depth is taken away, and Coulomb's friction."""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Where the body faces itself, in a crease or beneath an arm, there are two sheets of cloth. They
# divide the room between them and the body, rather than press each other into it.
SHARE_OF_ROOM = wp.constant(1.0 / 3.0)
ROUNDED = wp.constant(1.001)  # so that nothing that is near is too far, whatever is rounded


@wp.func
def held_slip(slip: wp.vec3, up: wp.vec3, most: float):
    """What friction takes back of a slip past a surface: its part along it, `most` at most."""
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
def narrowed(gap: float, room: wp.vec2):
    """What is left of a gap between sheets of cloth where the body faces itself.

    Args:
        gap: metres.
        room: from the body to itself, at both ends of the frame.
    """
    return wp.min(gap, SHARE_OF_ROOM * wp.min(room[0], room[1]))
