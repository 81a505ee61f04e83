import numpy as np
import pytest
import warp as wp

from drapeline.geometry.crossings import Crossings
from drapeline.geometry.mesh import edges, face_edges, triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.cloth_contact import NearTriangles
from drapeline.xpbd.contact import NEVER, make_all_moves, make_moves
from drapeline.xpbd.edge_contact import (
    CrossedTriangles,
    NearEdges,
    opposite_vertices,
    untangle,
)
from drapeline.xpbd.stepping import BusyLaunch
from toys.contacts import FAR, GAPS, MASS, RELEASE_M, after_contact
from toys.sheets import sheet


def touch(height, *, before=None, layer=0, shift=0.0, **options):
    """Places (4, 3) after a contact, those that count as before it, and those that it found.

    An edge along y, shifted along x, crosses another along x at a height; it was at the height
    `before`.
    """
    new = np.array([[-0.01, 0, 0], [0.02, 0, 0], [shift, -0.02, height], [shift, 0.01, height]])
    old = new.copy()
    old[2:, 2] = height if before is None else before
    layers = [0, 0, layer, layer]
    return *after_contact([[0, 1], [2, 3]], old, new, layers=layers, **options), new


def rise(place, at=(1 / 3, 2 / 3)):
    """Height of the second edge over the first, where they crossed."""
    under = place[0] + at[0] * (place[1] - place[0])
    return (place[2] + at[1] * (place[3] - place[2]) - under)[2]


@pytest.mark.parametrize(("layer", "clearance", "gap"), GAPS)
@pytest.mark.parametrize("side", [1, -1])
def test_edges_that_came_too_close_are_moved_to_the_gap(layer, clearance, gap, side):
    place, _, new = touch(side * 0.001, before=side * 0.02, layer=layer, clearance=clearance)
    assert rise(place) == pytest.approx(side * gap, abs=1e-6)
    np.testing.assert_allclose(MASS @ (place - new), 0, atol=1e-7)


@pytest.mark.parametrize(
    ("height", "shift", "clearance"),
    [(0.0071, 0.0, FAR), (0.001, 0.029, FAR), (0.0031, 0.0, (0.009, 0.009))],
)
def test_edges_that_do_not_meet_are_left(height, shift, clearance):
    place, _, new = touch(height, before=height + 0.001, shift=shift, clearance=clearance)
    np.testing.assert_allclose(place, new, atol=1e-9)


def test_old_depth_goes_slowly_and_gives_no_speed():
    place, before, _ = touch(0.001)
    assert rise(place) == pytest.approx(0.001 + RELEASE_M, abs=1e-6)
    np.testing.assert_allclose((place - before)[:, 2], 0, atol=1e-7)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("before", "kept"), [(0.02, 0.002), (0.002, 1e-3), (2e-4, 1.8e-4)])
def test_no_edge_passes_through_another(side, before, kept):
    place, _, new = touch(-side * 0.01, before=side * before, apart=True)
    assert rise(place) * side == pytest.approx(kept, abs=1e-6)
    np.testing.assert_allclose((place - new)[:2], -(place - new)[2:], atol=1e-6)


def vectors(values, dtype=wp.vec3):
    return wp.array(values, dtype=dtype)


@pytest.fixture
def searched(parallel):
    """A level sheet and an upright strip that passes through it, or ends above it."""
    start_warp()

    def search(height):
        level = sheet(0.0, rows=9, edge_m=0.02)
        across = sheet(0.0, rows=5, columns=4, edge_m=0.02).vertices + [0.003, 0.004, 0.0]
        upright = across[:, [2, 1, 0]] + [0.001, 0, height]
        quads = [level.faces, sheet(0.0, rows=5, columns=4).faces]
        cloths = [level.vertices.astype(np.float32), upright.astype(np.float32)]
        points = vectors(np.concatenate(cloths))
        triangles = triangulate(np.concatenate([quads[0], quads[1] + 81])).astype(np.int32)
        layers = vectors(np.repeat([0, 1], [81, 20]).astype(np.int32), int)
        near = NearTriangles(points, vectors(triangles, wp.vec3i), layers, 2, parallel=parallel)
        still = wp.zeros_like(points)
        near.find(points, still, np.zeros(3), time_s=0.0, margin_m=0.012, rest_share=0.9)
        near_edges = NearEdges(near, points.numpy(), parallel=parallel)
        near_edges.find(margin_m=0.012, rest_share=0.9)
        pairs = Crossings(cloths, quads).pairs_through(cloths)
        crossed = CrossedTriangles(near_edges.edges, near.triangles)
        crossed.take(pairs)
        crossed.free(points, near.near, near_edges.near)
        return pairs, triangles, near.near, near_edges

    return search


def never(near, numbers):
    """Things and others that are near, but never due."""
    due, count = near.due.numpy(), near.count.numpy()
    return {
        (i, int(other))
        for i in numbers
        for other, step in zip(near.other.numpy()[i], due[i, : count[i]], strict=False)
        if step == int(NEVER)
    }


def test_an_edge_and_a_triangle_that_it_passes_through_are_on_no_side_of_each_other(searched):
    pairs, triangles, near, near_edges = searched(0.033)
    ends = near_edges.edges.numpy()
    # The strip's four upright threads pass through the level sheet.
    threads = [edge for edge in np.unique(pairs[:, 0]) if (ends[edge] >= 81).all()]
    assert len(threads) >= 4
    _, sides = face_edges(triangles)
    beside = [np.flatnonzero((sides == edge).any(axis=1)) for edge in range(len(ends))]
    vertices, between = set(), set()
    for edge, face in pairs.tolist():
        vertices |= {(int(end), face) for end in ends[edge]}
        vertices |= {(int(corner), int(f)) for corner in triangles[face] for f in beside[edge]}
        between |= {tuple(sorted((edge, int(side)))) for side in sides[face]}
    freed, freed_edges = never(near, range(101)), never(near_edges.near, range(len(ends)))
    assert freed
    assert freed <= vertices
    assert freed_edges
    assert freed_edges <= between


def test_sheets_apart_do_not_cross_but_are_near(searched):
    pairs, _, near, _ = searched(0.045)
    assert len(pairs) == 0
    assert not never(near, range(101))
    assert near.count.numpy()[81:].max() > 0


def test_cloth_far_from_other_cloth_is_near_to_nothing(searched):
    _, _, near, _ = searched(0.2)
    assert near.count.numpy().sum() == 0


def test_corners_opposite_to_edges():
    triangles = np.array([[0, 1, 2], [2, 1, 3]])
    assert edges(triangles).tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    np.testing.assert_array_equal(
        opposite_vertices(triangles), [[2, -1], [1, -1], [0, 3], [2, -1], [1, -1]]
    )


def test_a_bowl_leaves_the_sheet_that_it_pokes_through(parallel):
    """As a whole nothing moves, or hardly where vertices share their moves; nothing gets speed."""
    start_warp()
    level = sheet(0.0, rows=9, edge_m=0.02)
    bowl = sheet(0.0, rows=5, edge_m=0.02).vertices + [0.003, 0.004, 0.0]
    bowl[:, 2] = 8 * (bowl[:, :2] ** 2).sum(axis=1) - 0.003
    quads = np.concatenate([level.faces, sheet(0.0, rows=5).faces + 81])
    points = np.concatenate([level.vertices, bowl]).astype(np.float32)
    triangles = triangulate(quads).astype(np.int32)
    pairs = edges(triangles).astype(np.int32)
    inverse = np.repeat([1.0, 2.0], [81, 25]).astype(np.float32)
    place = vectors(points)
    before = wp.clone(place)
    edge, face = vectors(pairs, wp.vec2i), vectors(triangles, wp.vec3i)
    seen = Crossings([points], [quads])
    crossings = CrossedTriangles(edge, face)
    opposite = vectors(opposite_vertices(triangles), wp.vec2i)
    move = BusyLaunch(
        untangle,
        crossings.count,
        [crossings.count, crossings.crossed, edge, opposite, face, vectors(inverse, float)],
        [5e-4, place, moves := make_moves(106 * parallel), before, place],
    )
    left = []
    for _ in range(15):
        crossings.take(seen.pairs_through([place.numpy()]))
        left.append(int(crossings.count.numpy().sum()))
        move.find()
        move.launch()
        wp.launch(make_all_moves, dim=len(moves.weight), inputs=[moves, before, place])
    assert left[0] > 4
    assert left[-1] == 0
    moved = place.numpy() - points
    ways = (moved / inverse[:, None])[:, 2]
    share = 0.25 if parallel else 1e-3
    assert abs(ways.sum()) < share * np.abs(ways).sum()  # all of it if one sheet alone moved
    if not parallel:
        np.testing.assert_allclose((moved / inverse[:, None]).sum(axis=0), 0, atol=1e-5)
    assert moved[81:, 2].max() > 1e-3
    np.testing.assert_allclose(before.numpy() - points, moved, atol=1e-6)
