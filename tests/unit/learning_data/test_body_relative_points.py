"""Points of clouds relative to the toy body beneath them."""

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.learning_data.body_relative_points import body_relative_points, joint_transforms
from drapeline.seeding import rng_for

SHAPE = np.full(10, 0.3)


def surface(body, poses):
    """Vertices and normals (F, V, 3) of the whole body in poses (F, 72)."""
    vertices = posed_vertices(body, SHAPE, poses)[0]
    return vertices, np.stack([vertex_normals(frame, body.faces) for frame in vertices])


def test_points_over_the_body_rest_where_what_is_beneath_them_rests(toy_body):
    poses = REST_POSE + rng_for(0, "body_relative_points").normal(0, 0.2, (2, 72))
    vertices, normals = surface(toy_body, poses)
    points = vertices + 0.02 * normals
    found = body_relative_points(toy_body, SHAPE, poses, points)
    assert found.shape == (*points.shape[:2], 7)
    np.testing.assert_array_equal(found[..., :3], points.astype(np.float32))
    gap = np.linalg.norm(found[..., 3:6] - rest_body(toy_body, SHAPE), axis=-1)
    assert np.median(gap) < 0.025  # 2 cm above it, but where parts blend
    np.testing.assert_allclose(np.median(found[..., 6]), np.arcsinh(0.02 / 0.005), atol=0.1)


def test_skin_has_no_height_and_millimetres_above_it_count(toy_body):
    poses = REST_POSE[None] + rng_for(0, "height").normal(0, 0.2, (2, 72))
    vertices, normals = surface(toy_body, poses)

    def heights(gap_m):
        return body_relative_points(toy_body, SHAPE, poses, vertices + gap_m * normals)[..., 6]

    np.testing.assert_allclose(heights(0.0), 0, atol=1e-3)
    assert np.median(heights(0.003)) > 0.5
    assert np.median(heights(0.03) - heights(0.003)) > 1.5


def test_transforms_are_the_motions_of_the_joints_with_a_fourth_row(toy_body):
    poses = REST_POSE + rng_for(0, "transforms").normal(0, 0.2, (2, 72))
    found = joint_transforms(toy_body, SHAPE, poses)
    assert (found.shape, found.dtype) == ((2, 24, 4, 4), np.float32)
    np.testing.assert_allclose(found[:, :, :3], rest_to_pose(toy_body, SHAPE, poses), atol=1e-6)
    np.testing.assert_array_equal(found[:, :, 3], np.broadcast_to([0, 0, 0, 1.0], (2, 24, 4)))
