"""Constraints of one colour share no vertex, so that several can be solved at once."""

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"  # greedy colouring is serial
_MOST_COLOURS = wp.constant(64)


@wp.kernel
def _colour(
    vertices: wp.array2d(dtype=int),
    taken: wp.array(dtype=wp.uint64),  # bit c of a vertex: it has a constraint of colour c
    colours: wp.array(dtype=int),
):
    i = wp.tid()
    used = wp.uint64(0)
    for k in range(vertices.shape[1]):
        used = used | taken[vertices[i, k]]
    colour = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    while colour < _MOST_COLOURS - 1 and ((used >> wp.uint64(colour)) & wp.uint64(1)) == wp.uint64(
        1
    ):
        colour += 1
    colours[i] = colour
    for k in range(vertices.shape[1]):
        vertex = vertices[i, k]
        taken[vertex] = taken[vertex] | (wp.uint64(1) << wp.uint64(colour))


def colour_constraints(vertices: np.ndarray, count: int) -> np.ndarray:
    """Colours (C,) such that no two constraints of one colour have a vertex in common.

    Greedy: each constraint takes the first colour that is free at all of its vertices. What is
    solved colour by colour has no direction, as lexical order would have, and all constraints of a
    colour can be solved at once (Fratarcangeli et al. 2016, "Vivace").

    Args:
        vertices: (C, K) int; a constraint may name a vertex twice.
        count: of vertices.
    """
    colours = wp.zeros(len(vertices), dtype=int, device=_DEVICE)
    wp.launch(
        _colour,
        dim=len(vertices),
        inputs=[wp.array(vertices.astype(np.int32), dtype=int, device=_DEVICE)],
        outputs=[wp.zeros(count, dtype=wp.uint64, device=_DEVICE), colours],
        device=_DEVICE,
    )
    found = colours.numpy().copy()
    late = np.flatnonzero(found == _MOST_COLOURS - 1)
    found[late] += np.arange(len(late), dtype=found.dtype)  # each has one of its own
    return found
