"""Constraints in an order in which neighbours share no vertex."""

import numpy as np


def colour_constraints(vertices: np.ndarray, count: int) -> np.ndarray:
    """Colours (C,) so that no two constraints of one colour have a vertex in common.

    Greedy: each takes the first colour that is free at all of its vertices. What is solved in the
    order of colours has no direction, as lexical order would, and all constraints of a colour
    could be solved at once (Fratarcangeli et al. 2016, "Vivace").

    Args:
        vertices: (C, K) int; a vertex may be named twice by one constraint.
        count: of vertices.
    """
    taken = np.zeros(count, dtype=np.int64)  # bit c of a vertex: colour c is taken there
    colours = np.zeros(len(vertices), dtype=np.int64)
    left = np.arange(len(vertices))
    # In rounds: a constraint has its turn when no other that waits and comes before it is beside it.
    while len(left):
        rows = vertices[left]
        first = np.full(count, len(vertices))
        np.minimum.at(first, rows, np.broadcast_to(left[:, None], rows.shape))
        turn = (first[rows] == left[:, None]).all(axis=1)
        chosen, mine = left[turn], rows[turn]
        free = ~np.bitwise_or.reduce(taken[mine], axis=1)
        lowest = free & -free
        colours[chosen] = np.round(np.log2(lowest.astype(np.float64))).astype(np.int64)
        np.bitwise_or.at(taken, mine, np.broadcast_to(lowest[:, None], mine.shape))
        left = left[~turn]
    return colours
