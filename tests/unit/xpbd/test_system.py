from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.system import colour_constraints, join_garments
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


@pytest.fixture(scope="module")
def pieces():
    start_warp()
    pin = np.zeros(25, dtype=np.float32)
    pin[[3, 7]] = 0.5
    quads = sheet(0.0, rows=4, edge_m=0.02, name="in")
    triangles = sheet(1.0, rows=5, edge_m=0.02, name="out", pin=pin)
    return quads, replace(triangles, faces=triangulate(triangles.faces))


def test_garments_stand_one_after_the_other(pieces):
    system = join_garments(pieces)
    assert system.starts.tolist() == [0, 16, 41]
    assert system.layers.tolist() == [0] * 16 + [1] * 25
    assert system.pinned.tolist() == [19, 23]
    assert system.pin_weights.tolist() == [0.5, 0.5]
    for part, piece in zip(system.split(system.vertices), pieces, strict=True):
        np.testing.assert_array_equal(part, piece.vertices)
    sides = system.layers[system.springs.pairs]
    np.testing.assert_array_equal(sides[:, 0], sides[:, 1])
    assert len(system.springs.pairs) == 24 + 18 + 56


def test_a_garment_weighs_its_area_times_its_density(pieces):
    system = join_garments(pieces)
    for part, piece in zip(system.split(1 / system.inverse_masses), pieces, strict=True):
        area = ((len(part) ** 0.5 - 1) * 0.02) ** 2
        assert part.sum() == pytest.approx(area * piece.fabric.density_kg_m2, rel=1e-4)


def test_constraints_of_a_colour_follow_one_another(pieces):
    """So that all of a colour can be solved at once: neighbours in the list share no vertex."""
    pairs = join_garments(pieces).springs.pairs
    assert not (set(pairs[0]) & set(pairs[1]))
    shared = [bool(set(one) & set(two)) for one, two in pairwise(pairs)]
    assert np.mean(shared) < 0.1
