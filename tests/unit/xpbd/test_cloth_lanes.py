"""Cloth near cloth in lanes against that in turn, which a GPU searches."""

import numpy as np
import pytest
import warp as wp

from drapeline.geometry.mesh import triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.cloth_contact import NearTriangles
from sheet_toys import sheet


def find(place, rest, triangles, layers, halves, *, together, margin_m):
    """Numbers and sides of the triangles near to each vertex, as a set for each."""
    near = NearTriangles(
        wp.array(rest.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(triangles.astype(np.int32), dtype=wp.vec3i, device="cpu"),
        wp.array(layers.astype(np.int32), dtype=int, device="cpu"),
        halves,
        together=together,
    )
    place = wp.array(place.astype(np.float32), dtype=wp.vec3, device="cpu")
    near.find(place, margin_m=margin_m, free_m=0.028)
    rows = zip(near.count.numpy(), near.near.numpy(), strict=True)
    return [set(row[:count].tolist()) for count, row in rows]


@pytest.mark.parametrize("halves", [1, 2])
def test_near_triangles_in_lanes_are_those_in_turn(halves):
    start_warp()
    one, two = sheet(0.0, rows=9, edge_m=0.02), sheet(0.006, rows=5, columns=6, edge_m=0.045)
    rest = np.concatenate([one.vertices, two.vertices])
    layers = np.repeat([0, 1], [len(one.vertices), len(two.vertices)])
    triangles = np.concatenate([triangulate(one.faces), len(one.vertices) + triangulate(two.faces)])
    place = rng_for(1, "crumple").normal(rest, 0.004)
    place[:36, 2] += 0.004  # rows that are folded over others of the same sheet
    place[:36, 1] = place[72:36:-1, 1]
    sides = [
        find(place, rest, triangles, layers, halves, together=together, margin_m=0.012)
        for together in (True, False)
    ]
    assert sides[0] == sides[1]
    assert any(number > 0 for row in sides[0] for number in row)
    assert any(number < 0 for row in sides[0] for number in row)


def test_a_vertex_near_to_too_many_keeps_as_many_as_have_room():
    start_warp()
    count = 40
    stack = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    rest = np.concatenate([*(stack + [0, 0, 1e-4 * k] for k in range(count)), [[0.02, 0.02, 0.01]]])
    layers = np.repeat([0, 1], [3 * count, 1])
    triangles = np.arange(3 * count).reshape(-1, 3)
    for together in (True, False):
        *_, last = find(rest, rest, triangles, layers, 1, together=together, margin_m=0.012)
        assert len(last) == 24
        assert min(last) > 0
