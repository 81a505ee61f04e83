import numpy as np

from drapeline.geometry.mesh import edges
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.colouring import colour_constraints
from toys.sheets import sheet


def slow_colours(vertices, count):
    """Each in turn takes the first colour that none of its vertices has."""
    taken = [set() for _ in range(count)]
    colours = []
    for row in vertices.tolist():
        used = set().union(*(taken[vertex] for vertex in row))
        colour = next(c for c in range(99) if c not in used)
        colours.append(colour)
        for vertex in row:
            taken[vertex].add(colour)
    return colours


def test_it_is_greedy():
    start_warp()
    rows = rng_for(1, "rows").integers(0, 40, (150, 4))
    assert colour_constraints(rows, 40).tolist() == slow_colours(rows, 40)


def test_edges_of_one_colour_share_no_vertex():
    start_warp()
    pairs = edges(sheet(0.0).faces)
    colours = colour_constraints(pairs, 169)
    assert colours.max() < 7
    for colour in np.unique(colours):
        ends = pairs[colours == colour].ravel()
        assert len(np.unique(ends)) == len(ends)


def test_a_hub_of_many_edges_is_coloured_as_well():
    start_warp()
    pairs = np.stack([np.zeros(90, dtype=int), np.arange(1, 91)], axis=1)
    assert len(np.unique(colour_constraints(pairs, 91))) == 90
