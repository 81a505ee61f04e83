"""Cloth over the body's vertices, on a processor in lanes and as a GPU searches it."""

import numpy as np
import trimesh
import warp as wp

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.simulation.collider import MovingBody
from drapeline.xpbd.body_vertices import CoveredVertices
from drapeline.xpbd.cloth_contact import NearTriangles
from drapeline.xpbd.lanes import COVER_ASIDE, FACING, SLOTS
from toys.sheets import sheet

MARGIN_M, SLACK = 0.012, 1e-5


def covers_of(body, ups, place, triangles, halves, parallel):
    """[{triangle}] over each vertex of a body, whose normals are `ups`."""
    faces = wp.array(triangles.astype(np.int32), dtype=wp.vec3i)
    layers = wp.zeros(len(place), dtype=int)
    at = wp.array(place.astype(np.float32), dtype=wp.vec3)
    cloth = NearTriangles(at, faces, layers, halves, parallel=parallel)
    skin = CoveredVertices(body, cloth, parallel=parallel)
    start = wp.array(body.frame(0).astype(np.float32), dtype=wp.vec3)
    normals = wp.array(ups.astype(np.float32), dtype=wp.vec3)
    skin.find(at, (start, start, normals), margin_m=MARGIN_M)
    np.testing.assert_array_equal(skin.up.numpy(), np.float32(ups))
    return [set(row[:n]) for n, row in zip(skin.count.numpy(), skin.covers.numpy(), strict=True)]


def slow_covers(points, ups, place, triangles, slack):
    """The same for each vertex and triangle, by bounds that are wider by `slack`; (V, F)."""
    a, b, c = place[triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    slope = ups @ normals.T
    height = ((a[None] - points[:, None]) * normals).sum(axis=2) / slope
    at = points[:, None] + ups[:, None] * height[..., None] - a
    u = (np.cross(at, c - a) * normals).sum(axis=2) / size**2
    v = (np.cross(b - a, at) * normals).sum(axis=2) / size**2
    low, high = place[triangles].min(axis=1), place[triangles].max(axis=1)
    beside = MARGIN_M + slack
    near = ((points[:, None] > low - beside) & (points[:, None] < high + beside)).all(axis=2)
    near &= (slope > (FACING - slack) * size) & (np.abs(height) < beside)
    return near & (np.minimum(u, v) > -COVER_ASIDE - slack) & (u + v < 1 + COVER_ASIDE + slack)


def test_triangles_over_the_body_are_those_of_a_slow_search(tmp_path, parallel):
    """All that cover it for certain, and none that certainly do not, as many as there is room."""
    start_warp()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    write_point_cache(tmp_path / "ball.pc2", [np.float32(ball.vertices)])
    segments = np.full(len(ball.vertices), JOINT_NAMES.index("spine2"))
    tilt = trimesh.unitize(ball.vertices + rng_for(1, "up").normal(0, 0.03, ball.vertices.shape))
    rings = trimesh.creation.icosphere(subdivisions=2, radius=0.104)
    crumpled = rings.vertices + rng_for(2, "crumpled").normal(0, 0.015, rings.vertices.shape)
    with PointCache(tmp_path / "ball.pc2") as cache:
        body = MovingBody(cache, ball.faces, segments)
        found = covers_of(body, tilt, crumpled, rings.faces, 1, parallel)
    args = ball.vertices, tilt, crumpled, rings.faces
    sure, possible = (slow_covers(*args, slack) for slack in (-SLACK, SLACK))
    assert possible.sum() - sure.sum() < 0.05 * sure.sum()
    counts = set()
    for triangles, certain, allowed in zip(found, sure, possible, strict=True):
        certain, allowed = (set(np.flatnonzero(row)) for row in (certain, allowed))
        assert triangles <= allowed
        assert certain <= triangles or len(triangles) == SLOTS
        counts.add(len(triangles))
    assert {0, 1, 2, SLOTS} <= counts


def test_both_halves_of_a_quad_are_looked_at(tmp_path, parallel):
    start_warp()
    level = sheet(0.005, rows=3, edge_m=0.03)
    points = np.float32([[0.005, 0.02, 0], [0.02, 0.005, 0], [0.3, 0.3, 0]])
    write_point_cache(tmp_path / "points.pc2", [points])
    segments = np.full(3, JOINT_NAMES.index("spine2"))
    triangles = triangulate(level.faces)
    with PointCache(tmp_path / "points.pc2") as cache:
        body = MovingBody(cache, np.array([[0, 1, 2]]), segments)
        ups = np.tile([0.0, 0, 1], (3, 1))
        found = covers_of(body, ups, level.vertices, triangles, 2, parallel)
    expected = slow_covers(points, ups, level.vertices, triangles, 0)
    assert [sorted(row) for row in found] == [np.flatnonzero(row).tolist() for row in expected]
    assert {number % 2 for row in found for number in row} == {0, 1}
