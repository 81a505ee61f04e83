"""What networks see of a body."""

from dataclasses import replace

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.models.garment4d.body_input import BodySet, BodySurface
from drapeline.seeding import rng_for
from garment4d_toys import toy_bodies


def test_body_points_and_normals_are_those_of_the_whole_body(toy_body):
    rng = rng_for(0, "surface")
    chosen = rng.permutation(len(toy_body.v_template))[:30]
    shape, poses = rng.uniform(-2, 2, 10), REST_POSE + rng.normal(0, 0.3, (4, 72))
    whole, _ = posed_vertices(toy_body, shape, poses)
    vertices, normals = BodySurface(toy_body, chosen).posed(shape, poses)
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
    vertices, _ = BodySurface(body, np.arange(25)).posed(shape, poses)
    np.testing.assert_allclose(vertices, whole[:, :25], atol=1e-5)
    assert np.abs(whole - posed_vertices(toy_body, shape, poses)[0]).max() > 0.005


def test_points_over_the_body_rest_where_what_is_beneath_them_rests(toy_body):
    wearer = BodySet(toy_bodies(toy_body), 30).of(0, np.full(10, 0.3))
    poses = REST_POSE + rng_for(0, "body_relative_points").normal(0, 0.2, (2, 72))
    body, normals = wearer.shown(poses)
    points = body + 0.02 * normals
    found = wearer.body_relative_points(points, poses)
    assert found.shape == (*points.shape[:2], 7)
    np.testing.assert_array_equal(found[..., :3], points)
    rest, _ = wearer.rest
    gap = np.linalg.norm(found[..., 3:6] - rest, axis=-1)
    assert np.median(gap) < 0.025  # 2 cm above it, but where parts blend
    np.testing.assert_allclose(np.median(found[..., 6]), np.arcsinh(0.02 / 0.005), atol=0.1)


def test_skin_has_no_height_and_millimetres_above_it_count(toy_body):
    wearer = BodySet(toy_bodies(toy_body), 30).of(0, np.full(10, 0.3))
    poses = REST_POSE[None] + rng_for(0, "height").normal(0, 0.2, (2, 72))
    body = posed_vertices(wearer.model, wearer.shape, poses)[0]
    np.testing.assert_allclose(wearer.body_relative_points(body, poses)[..., 6], 0, atol=1e-3)
    out = np.stack([vertex_normals(frame, toy_body.faces) for frame in body])
    low, high = (
        wearer.body_relative_points(body + gap * out, poses)[..., 6] for gap in (0.003, 0.03)
    )
    assert np.median(low) > 0.5
    assert np.median(high - low) > 1.5
