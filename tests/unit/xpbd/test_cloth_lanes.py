"""Cloth near cloth, on a processor in lanes and as a GPU searches it, against a slow search."""

import numpy as np
import pytest
import warp as wp

from drapeline.geometry.mesh import triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.cloth_contact import NearTriangles
from toys.sheets import sheet

MARGIN_M, FREE_M = 0.012, 0.028
SLACK = 1e-5  # far more than the search's numbers are rounded by


def find(place, rest, triangles, layers, halves, parallel):
    """{(vertex, triangle): side} of the triangles near to each vertex."""
    start_warp()
    near = NearTriangles(
        wp.array(rest.astype(np.float32), dtype=wp.vec3),
        wp.array(triangles.astype(np.int32), dtype=wp.vec3i),
        wp.array(layers.astype(np.int32), dtype=int),
        halves,
        parallel=parallel,
    )
    place = wp.array(place.astype(np.float32), dtype=wp.vec3)
    near.find(place, margin_m=MARGIN_M, free_m=FREE_M)
    rows = zip(near.count.numpy(), near.near.numpy(), strict=True)
    return {(i, abs(n) - 1): np.sign(n) for i, (count, row) in enumerate(rows) for n in row[:count]}


def slow_near(place, rest, triangles, layers, halves, slack):
    """Triangles near to each vertex, one by one, by bounds that are wider by `slack`, and heights.

    Returns:
        {(vertex, triangle): height}.
    """
    faces = triangles.reshape(-1, halves, 3)
    boxes = np.array([[place[f].min((0, 1)), place[f].max((0, 1))] for f in faces])
    at_rest = [(rest[f].min((0, 1)), rest[f].max((0, 1))) for f in faces]
    margin_m = MARGIN_M + slack
    found = {}
    for i, p in enumerate(place):
        for number, (a, b, c) in enumerate(triangles):
            low, high = boxes[number // halves]
            own = layers[i] == layers[a]
            start, end = at_rest[number // halves]
            free = max(FREE_M, 0.5005 * np.linalg.norm(end - start)) - slack
            if own and np.linalg.norm(rest[i] - (start + end) / 2) <= free:
                continue
            if (p < low - margin_m).any() or (p > high + margin_m).any():
                continue
            sides = np.stack([place[b] - place[a], place[c] - place[a]], axis=1)
            normal = np.cross(*sides.T)
            height = (p - place[a]) @ normal / np.linalg.norm(normal)
            u, v = np.linalg.lstsq(sides, p - place[a], rcond=None)[0]
            aside = 0.4 + 100 * slack
            if abs(height) < margin_m and u > -aside and v > -aside and u + v < 1 + aside:
                found[i, number] = height
    return found


@pytest.fixture(scope="module")
def crumpled():
    """Two sheets in layers, some rows of which are folded over others of the same sheet."""
    one, two = sheet(0.0, rows=9, edge_m=0.02), sheet(0.006, rows=5, columns=6, edge_m=0.045)
    rest = np.concatenate([one.vertices, two.vertices])
    layers = np.repeat([0, 1], [len(one.vertices), len(two.vertices)])
    triangles = np.concatenate([triangulate(one.faces), len(one.vertices) + triangulate(two.faces)])
    place = rng_for(1, "crumple").normal(rest, 0.004).astype(np.float32)
    place[:36, 2] += 0.004
    place[:36, 1] = place[72:36:-1, 1]
    return place, rest, triangles, layers


@pytest.mark.parametrize("halves", [1, 2])
def test_near_triangles_are_those_of_a_slow_search(crumpled, halves, parallel):
    """All that are near for certain, and none that are certainly not."""
    *_, triangles, layers = crumpled
    found = find(*crumpled, halves, parallel)
    sure, possible = (slow_near(*crumpled, halves, slack) for slack in (-SLACK, SLACK))
    assert set(sure) <= set(found) <= set(possible)
    assert len(possible) - len(sure) < 0.05 * len(sure)
    clear = [near for near in found if abs(possible[near]) > SLACK]
    assert [found[near] for near in clear] == [np.sign(possible[near]) for near in clear]
    assert {found[near] for near in clear} == {-1, 1}
    own = [layers[i] == layers[triangles[number, 0]] for i, number in found]
    assert any(own)
    assert not all(own)


def test_a_vertex_near_to_too_many_keeps_as_many_as_have_room(parallel):
    count = 40
    stack = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    rest = np.concatenate([*(stack + [0, 0, 1e-4 * k] for k in range(count)), [[0.02, 0.02, 0.01]]])
    layers = np.repeat([0, 1], [3 * count, 1])
    triangles = np.arange(3 * count).reshape(-1, 3)
    near = find(rest, rest, triangles, layers, 1, parallel)
    sides = [side for (vertex, _), side in near.items() if vertex == 3 * count]
    assert sides == [1] * 24
