"""Cloth near cloth, on a processor in lanes and as a GPU searches it, against a slow search."""

import igl
import numpy as np
import pytest
import warp as wp

from drapeline.geometry.mesh import face_edges, triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.cloth_contact import NearTriangles
from drapeline.xpbd.edge_contact import NearEdges
from toys.sheets import sheet

MARGIN_M, SHARE, TIME_S = 0.012, 0.9, 0.004
SLACK = 1e-5  # far more than the search's numbers are rounded by


def search(place, speed, rest, triangles, layers, halves, parallel):
    """{(vertex, triangle)} and {(edge, edge)} that are near."""
    start_warp()
    near = NearTriangles(
        wp.array(rest.astype(np.float32), dtype=wp.vec3),
        wp.array(triangles.astype(np.int32), dtype=wp.vec3i),
        wp.array(layers.astype(np.int32), dtype=int),
        halves,
        parallel=parallel,
    )
    near_edges = NearEdges(near, rest.astype(np.float32), parallel=parallel)
    place, speed = (wp.array(np.float32(part), dtype=wp.vec3) for part in (place, speed))
    near.find(place, speed, np.zeros(3), time_s=TIME_S, margin_m=MARGIN_M, rest_share=SHARE)
    near_edges.find(margin_m=MARGIN_M, rest_share=SHARE)
    return tuple(
        {
            (i, int(n))
            for i, (count, row) in enumerate(
                zip(found.count.numpy(), found.other.numpy(), strict=True)
            )
            for n in row[:count]
        }
        for found in (near.near, near_edges.near)
    )


def passing(sweep, mean, spread):
    return np.linalg.norm(sweep - mean, axis=-1) + spread


@pytest.fixture(scope="module")
def crumpled():
    """Two sheets in layers, some rows of which are folded over others of the same sheet."""
    one, two = sheet(0.0, rows=9, edge_m=0.02), sheet(0.006, rows=5, columns=6, edge_m=0.045)
    rest = np.concatenate([one.vertices, two.vertices])
    layers = np.repeat([0, 1], [len(one.vertices), len(two.vertices)])
    triangles = np.concatenate([triangulate(one.faces), len(one.vertices) + triangulate(two.faces)])
    rng = rng_for(1, "crumple")
    place = rng.normal(rest, 0.004).astype(np.float32)
    place[:36, 2] += 0.004
    place[:36, 1] = place[72:36:-1, 1]
    speed = np.where(np.arange(len(rest))[:, None] < 40, [0, 0, -1.5], [0.5, 0, 0.3])
    return place, rng.normal(speed, 0.2), rest, triangles, layers


def slow_sweeps(speed, triangles, halves):
    """Half of the ways of vertices (V, 3), and mean and spread of those of faces."""
    sweep = speed * TIME_S / 2
    corners = sweep[triangles.reshape(-1, halves, 3)[:, :, :]]
    # A quad's corners, or a triangle's of which the last counts twice.
    four = np.concatenate([corners[:, 0], corners[:, -1, 2:]], axis=1)
    mean = four.mean(axis=1)
    return sweep, mean, np.linalg.norm(four - mean[:, None], axis=2).max(axis=1)


@pytest.mark.parametrize("halves", [1, 2])
def test_near_triangles_are_those_of_a_slow_search(crumpled, halves, parallel):
    """All that are near for certain, and none that are certainly not."""
    place, speed, rest, triangles, layers = crumpled
    found, _ = search(*crumpled, halves, parallel)
    sweep, mean, spread = slow_sweeps(speed, triangles, halves)
    middle = place + sweep
    faces = triangles.reshape(-1, 3 * halves)
    low, high = rest[faces].min(axis=1), rest[faces].max(axis=1)
    sure, possible = set(), set()
    for number, corners in enumerate(triangles):
        face = number // halves
        squared, *_ = igl.point_mesh_squared_distance(
            middle.astype(np.float64), middle[corners].astype(np.float64), np.array([[0, 1, 2]])
        )
        reach = MARGIN_M + passing(sweep, mean[face], spread[face])
        room = np.linalg.norm(rest - (low[face] + high[face]) / 2, axis=1)
        room = SHARE * (room - 1.001 * np.linalg.norm(high[face] - low[face]) / 2)
        reach = np.where(layers == layers[corners[0]], np.minimum(reach, room), reach)
        sure |= {(i, number) for i in np.flatnonzero(np.sqrt(squared) < reach - SLACK)}
        possible |= {(i, number) for i in np.flatnonzero(np.sqrt(squared) < reach + SLACK)}
    assert sure <= found <= possible
    assert len(possible) - len(sure) < 0.05 * len(sure)
    own = [layers[i] == layers[triangles[number, 0]] for i, number in found]
    assert any(own)
    assert not all(own)
    assert not [pair for pair in found if pair[0] in triangles[pair[1]]]


def distances(place, one, others):
    """(M,) distances of an edge from other edges (M, 2), by many points on each."""
    share = np.linspace(0, 1, 201)[:, None]
    mine = place[one[0]] + share * (place[one[1]] - place[one[0]])
    start, way = place[others[:, 0]], place[others[:, 1]] - place[others[:, 0]]
    at = np.einsum("pmi,mi->pm", mine[:, None] - start, way) / (way**2).sum(axis=1)
    nearest = start + np.clip(at, 0, 1)[..., None] * way
    return np.linalg.norm(mine[:, None] - nearest, axis=2).min(axis=0)


def test_near_edges_are_those_of_a_slow_search(crumpled, parallel):
    place, speed, rest, triangles, layers = crumpled
    _, found = search(*crumpled, 2, parallel)
    sweep, mean, spread = slow_sweeps(speed, triangles, 2)
    pairs, sides = face_edges(triangles)
    owner = np.full(len(pairs), -1)
    for number in range(len(triangles) - 1, -1, -1):
        owner[sides[number]] = number // 2
    middle, coarse = place + sweep, 3e-5
    sure, possible = set(), set()
    for edge, ends in enumerate(pairs):
        others = np.arange(edge + 1, len(pairs))
        others = others[~np.isin(pairs[others], ends).any(axis=1)]
        if not len(others):
            continue
        way = sweep[ends].mean(axis=0)
        reach = MARGIN_M + passing(way, mean[owner[others]], spread[owner[others]])
        reach += np.linalg.norm(sweep[ends[0]] - sweep[ends[1]]) / 2
        room = SHARE * distances(rest, ends, pairs[others])
        own = layers[ends[0]] == layers[pairs[others, 0]]
        reach = np.where(own, np.minimum(reach, room), reach)
        away = distances(middle, ends, pairs[others])
        sure |= {(edge, int(n)) for n in others[away < reach - coarse]}
        possible |= {(edge, int(n)) for n in others[away < reach + coarse]}
    assert sure <= found <= possible
    assert len(possible) - len(sure) < 0.05 * len(sure)
