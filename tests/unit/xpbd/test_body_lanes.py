"""The body's nearest points and rays to it, on a processor in lanes and as a GPU searches them."""

import igl
import numpy as np
import trimesh
import warp as wp

from drapeline.geometry.lanes import LaneInts, make_patches, repeat_first
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.body_contact import look_one_per_thread, search_one_per_thread
from drapeline.xpbd.lanes import look_in_lanes, search_in_lanes
from toys.rays import rays_clear_of_edges

COUNT, REACH_M = 600, 0.05


def array(values, dtype):
    return wp.array(values, dtype=dtype)


def test_a_limb_comes_first_and_then_the_whole_body(parallel):
    start_warp()
    rng = rng_for(1, "points")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    limbs = [ball.vertices + [x, 0, 0] for x in (0.0, 0.15)]
    surfaces = [*((limb, ball.faces) for limb in limbs), trimesh.util.append_faces(
        limbs, [ball.faces, ball.faces]
    )]  # fmt: skip
    homes = np.repeat([0, 1, 2], [301, 200, 99])
    points = rng.uniform(-0.15, 0.15, (COUNT, 3)) + homes[:, None] * [0.075, 0, 0]
    reaches = rng.choice([0, 0.01, 0.03], COUNT)

    meshes = [
        wp.Mesh(array(points.astype(np.float32), wp.vec3), array(faces.ravel(), int))
        for points, faces in surfaces
    ]
    given = [
        array(np.array([mesh.id for mesh in meshes], dtype=np.uint64), wp.uint64),
        array(homes.astype(np.int32), int),
    ]
    asked = [array(points.astype(np.float32), wp.vec3), REACH_M]
    asked.append(array(reaches.astype(np.float32), float))
    parts, found = (wp.full(COUNT, -1, dtype=int) for _ in range(2))
    weights = wp.zeros(COUNT, dtype=wp.vec3)
    kernel, size, inputs = search_one_per_thread, COUNT, [*given, *asked]
    if not parallel:
        patches = array(repeat_first(make_patches(points, homes)), LaneInts)
        again = wp.zeros(COUNT, dtype=float)
        kernel, size = search_in_lanes, len(patches)
        inputs = [*given, patches, *asked, again]
    wp.launch(kernel, size, inputs, [parts, found, weights])

    away = np.sqrt([igl.point_mesh_squared_distance(points, *surface)[0] for surface in surfaces])
    at_home, whole = away[homes, np.arange(COUNT)], away[2]
    expected = np.where(at_home < reaches, homes, np.where(whole < REACH_M, 2, -1))
    expected[(reaches == 0) | ((homes == 2) & (at_home >= reaches))] = -1
    assert set(expected[homes == 0]) == {-1, 0, 2}
    # One whose distance is its reach, to rounding, may be found or not.
    clear = np.minimum(np.abs(at_home - reaches), np.abs(whole - REACH_M)) > 1e-5
    assert clear.mean() > 0.9
    face, weight = found.numpy(), weights.numpy()
    part = np.where(face >= 0, parts.numpy(), -1)
    np.testing.assert_array_equal(part[clear], expected[clear])
    for number, (vertices, faces) in enumerate(surfaces):
        on = part == number
        near = np.einsum("pki,pk->pi", vertices[faces[face[on]]], weight[on])
        distance = np.linalg.norm(points[on] - near, axis=1)
        np.testing.assert_allclose(distance, away[number, on], atol=1e-5)


def slow_hit(point, way, triangles):
    """How far along a ray the first of triangles (F, 3, 3) is, by solving for all."""
    first, second, third = triangles.transpose(1, 0, 2)
    sides = np.stack([second - first, third - first, np.broadcast_to(-way, first.shape)], axis=2)
    found = np.linalg.solve(sides, (point - first)[..., None])[..., 0]
    inside = (found.min(axis=1) >= 0) & (found[:, :2].sum(axis=1) <= 1)
    return found[inside, 2].min(initial=np.inf)


def test_rays_hit_what_is_nearest_along_them(parallel):
    """From points around two balls, of lengths that many do not reach one with."""
    start_warp()
    rng = rng_for(2, "rays")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    vertices, faces = trimesh.util.append_faces(
        [ball.vertices, ball.vertices + [0.15, 0, 0]], [ball.faces, ball.faces]
    )
    points = rng.uniform([-0.12, -0.12, -0.12], [0.27, 0.12, 0.12], (COUNT, 3))
    ways = trimesh.unitize(rng.normal(size=(COUNT, 3)))
    reaches = rng.choice([0, 0.1, 0.3], COUNT)

    mesh = wp.Mesh(array(vertices.astype(np.float32), wp.vec3), array(faces.ravel(), int))
    rays = [array(values.astype(np.float32), wp.vec3) for values in (points, ways)]
    rays.append(array(reaches.astype(np.float32), float))
    found, weights = wp.full(COUNT, -7, dtype=int), wp.zeros(COUNT, dtype=wp.vec3)
    kernel, size, inputs = look_one_per_thread, COUNT, [mesh.id, *rays]
    if not parallel:
        patches = array(repeat_first(make_patches(points, np.zeros(COUNT, int))), LaneInts)
        kernel, size, inputs = look_in_lanes, len(patches), [mesh.id, patches, *rays]
    wp.launch(kernel, size, inputs, [found, weights])

    away = np.array([slow_hit(p, w, vertices[faces]) for p, w in zip(points, ways, strict=True)])
    expected = away < reaches
    assert 0.1 < expected.mean() < 0.5
    clear = (np.abs(away - reaches) > 1e-5) & (away > 1e-5)
    clear &= rays_clear_of_edges(points, ways, vertices[faces])
    assert clear.mean() > 0.9
    face, hit = found.numpy(), found.numpy() >= 0
    np.testing.assert_array_equal(hit[clear], expected[clear])
    assert (face[~hit] == -1).all()
    hit &= clear
    places = np.einsum("pki,pk->pi", vertices[faces[face[hit]]], weights.numpy()[hit])
    along = np.einsum("pi,pi->p", places - points[hit], ways[hit])
    np.testing.assert_allclose(along, away[hit], atol=1e-5)
    np.testing.assert_allclose(points[hit] + along[:, None] * ways[hit], places, atol=1e-5)
