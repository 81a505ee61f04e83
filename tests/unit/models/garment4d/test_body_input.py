"""What networks are given of a body."""

from dataclasses import replace

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.models.garment4d.data import BodySet, SurfaceSample
from drapeline.seeding import rng_for
from toys.garment4d import toy_bodies


def test_body_points_and_normals_are_those_of_the_whole_body(toy_body):
    rng = rng_for(0, "surface")
    chosen = rng.permutation(len(toy_body.v_template))[:30]
    shape, poses = rng.uniform(-2, 2, 10), REST_POSE + rng.normal(0, 0.3, (4, 72))
    whole, _ = posed_vertices(toy_body, shape, poses)
    vertices, normals = SurfaceSample(toy_body, chosen).pose(shape, poses)
    np.testing.assert_allclose(vertices, whole[:, chosen], atol=1e-6)
    for frame in range(4):
        expected = vertex_normals(whole[frame], toy_body.faces)[chosen]
        np.testing.assert_allclose(normals[frame], expected, atol=1e-4)


def test_pose_blend_shapes_reach_the_body_points(toy_body):
    rng = rng_for(0, "blend shapes")
    body = replace(
        toy_body, posedirs=rng.normal(0, 0.01, toy_body.posedirs.shape).astype(np.float32)
    )
    shape, poses = np.zeros(10), REST_POSE + rng.normal(0, 0.3, (2, 72))
    whole, _ = posed_vertices(body, shape, poses)
    vertices, _ = SurfaceSample(body, np.arange(25)).pose(shape, poses)
    np.testing.assert_allclose(vertices, whole[:, :25], atol=1e-5)
    assert np.abs(whole - posed_vertices(toy_body, shape, poses)[0]).max() > 0.005


def test_bodies_of_both_genders_show_the_same_vertices(toy_body):
    bodies = BodySet(toy_bodies(toy_body), 30)
    arrays = bodies.arrays()
    np.testing.assert_array_equal(arrays["female/chosen"], arrays["male/chosen"])
    assert len(np.unique(arrays["female/chosen"])) == 30
    body = bodies.of("male", np.full(10, 0.3))
    assert body.model is bodies.models["male"]
    whole, _ = posed_vertices(toy_body, body.shape, REST_POSE[None])
    vertices, normals = body.rest_surface
    np.testing.assert_allclose(vertices, whole[0, arrays["male/chosen"]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
