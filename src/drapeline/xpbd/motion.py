"""Particles in motion: prediction, what holds them, and their speed at the end of a step.

Between prediction and contact a particle's place and its inverse mass stand in one vector of four,
which a processor reads and writes at once.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

_GRAVITY = wp.constant(wp.vec3(0.0, 0.0, -9.81))


@wp.kernel
def tick(steps: int, ticks: wp.array(dtype=int), clock: wp.array(dtype=float)):
    """Let the clock show when the next of a frame's small steps begins and ends, from 0 to 1."""
    step = ticks[0]
    clock[0] = float(step) / float(steps)
    clock[1] = float(step + 1) / float(steps)
    ticks[0] = (step + 1) % steps


@wp.kernel
def predict(
    keep: wp.array(dtype=float),  # share of the speed that the air leaves
    carry: wp.array(dtype=wp.vec3),
    step_s: float,
    speed: wp.array(dtype=wp.vec3),
    way: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
    weighed: wp.array(dtype=wp.vec4),
):
    """Where particles go by their speed, gravity and the air alone."""
    i = wp.tid()
    start = place[i] + carry[0]
    free = (speed[i] + _GRAVITY * step_s) * keep[i]
    end = start + free * step_s
    speed[i] = free
    way[i] = end - start  # as it was rounded
    before[i] = start
    weighed[i] = wp.vec4(end[0], end[1], end[2], weighed[i][3])


@wp.kernel
def hold(
    vertices: wp.array(dtype=int),
    pull: wp.array(dtype=float),
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    clock: wp.array(dtype=float),
    weighed: wp.array(dtype=wp.vec4),
):
    """Pull held vertices to where they are held, which moves between two frames."""
    i = wp.tid()
    target = start[i] + (end[i] - start[i]) * clock[1]
    vertex = weighed[vertices[i]]
    goal = wp.vec4(target[0], target[1], target[2], vertex[3])
    weighed[vertices[i]] = vertex + (goal - vertex) * pull[i]


@wp.kernel
def take_places(weighed: wp.array(dtype=wp.vec4), place: wp.array(dtype=wp.vec3)):
    """Where the cloth's own forces have left particles."""
    i = wp.tid()
    place[i] = wp.vec3(weighed[i][0], weighed[i][1], weighed[i][2])


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
