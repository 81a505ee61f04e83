"""Particles in motion: prediction, what holds them, and their speed at the end of a step."""

import warp as wp

wp.set_module_options({"enable_backward": False})

_GRAVITY = wp.constant(wp.vec3(0.0, 0.0, -9.81))


@wp.kernel
def predict(
    keep: wp.array(dtype=float),  # share of the speed that the air leaves
    carry: wp.array(dtype=wp.vec3),
    step_s: float,
    speed: wp.array(dtype=wp.vec3),
    way: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    """Where particles go by their speed, gravity and the air alone."""
    i = wp.tid()
    start = place[i] + carry[0]
    free = (speed[i] + _GRAVITY * step_s) * keep[i]
    end = start + free * step_s
    speed[i] = free
    way[i] = end - start  # as it was rounded
    before[i] = start
    place[i] = end


@wp.kernel
def hold(
    vertices: wp.array(dtype=int),
    pull: wp.array(dtype=float),
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    clock: wp.array(dtype=float),
    place: wp.array(dtype=wp.vec3),
):
    """Pull held vertices to where they are held, which moves between two frames."""
    i = wp.tid()
    target = start[i] + (end[i] - start[i]) * clock[1]
    vertex = vertices[i]
    place[vertex] = place[vertex] + (target - place[vertex]) * pull[i]


@wp.kernel
def take_speed(
    way: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
    step_s: float,
    speed: wp.array(dtype=wp.vec3),
):
    """Add to the predicted speed what the way of a step became longer than predicted.

    The whole way over the step's time would be the same but for rounding: what gravity adds to a
    way in so short a step is a few units in the last place of the position.
    """
    i = wp.tid()
    speed[i] = speed[i] + (place[i] - before[i] - way[i]) / step_s


@wp.kernel
def add_speed(more: wp.vec3, speed: wp.array(dtype=wp.vec3)):
    """Add to the speed of all particles."""
    i = wp.tid()
    speed[i] = speed[i] + more
