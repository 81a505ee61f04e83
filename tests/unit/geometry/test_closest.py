"""Closest points on a triangle, a cube and a ball."""

import numpy as np
import pytest
import trimesh

from drapeline.geometry.closest import closest_points


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ([0.2, 0.2, 0.5], [0.2, 0.2, 0]),  # above the face
        ([0.5, -1, 0], [0.5, 0, 0]),  # beside an edge
        ([-1, -1, 1], [0, 0, 0]),  # beyond a corner
        ([1, 1, 0], [0.5, 0.5, 0]),  # beside the long edge
    ],
)
def test_closest_points_of_a_triangle(point, expected):
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    place, face = closest_points(np.array([point]), triangle, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(place[0], expected, atol=1e-6)
    assert face.tolist() == [0]
    assert place.dtype == np.float32


def test_the_face_that_is_returned_holds_the_place():
    cube = trimesh.creation.box()
    points = np.random.default_rng(0).uniform(-2, 2, (200, 3))
    points = points[(np.abs(points) > 0.5).any(axis=1)]
    place, face = closest_points(points, cube.vertices, cube.faces)
    np.testing.assert_allclose(place, np.clip(points, -0.5, 0.5), atol=1e-6)
    above = place - cube.vertices[cube.faces[face, 0]]
    height = np.einsum("pi,pi->p", above, cube.face_normals[face])
    np.testing.assert_allclose(height, 0, atol=1e-6)


def test_closest_points_from_within_a_ball_lie_on_its_surface():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    points = 0.3 * np.eye(3)
    place, _ = closest_points(points, ball.vertices, ball.faces)
    np.testing.assert_allclose(place, 0.5 * np.eye(3), atol=0.02)
