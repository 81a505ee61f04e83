"""Closest points on a triangle, a cube and a ball, and on what faces the same way."""

import numpy as np
import pytest
import trimesh

from drapeline.geometry.closest import closest_facing, closest_points


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


@pytest.mark.parametrize("spread_m", [0.02, 1.0])
def test_closest_points_of_a_soup_are_those_of_a_loop_over_faces(spread_m):
    rng = np.random.default_rng(1)
    soup = rng.uniform(-1, 1, (80, 1, 3)) + rng.normal(0, 0.2, (80, 3, 3))
    points = soup[:, 0] + rng.normal(0, spread_m, (80, 3))
    place, face = closest_points(points[:77], soup.reshape(-1, 3), np.arange(240).reshape(80, 3))
    nearest = np.stack([trimesh.triangles.closest_point(soup, [p] * 80) for p in points[:77]])
    away = np.linalg.norm(nearest - points[:77, None], axis=2)
    np.testing.assert_allclose(np.linalg.norm(place - points[:77], axis=1), away.min(1), atol=1e-6)
    np.testing.assert_allclose(away[np.arange(77), face], away.min(axis=1), atol=1e-6)


def test_the_order_of_points_does_not_matter():
    ball = trimesh.creation.icosphere(subdivisions=2)
    points = np.random.default_rng(2).normal(size=(50, 3))
    order = np.random.default_rng(3).permutation(50)
    place, face = closest_points(points, ball.vertices, ball.faces)
    again, other = closest_points(points[order], ball.vertices, ball.faces)
    np.testing.assert_allclose(again, place[order], atol=1e-6)
    assert other.tolist() == face[order].tolist()


@pytest.mark.parametrize(
    "line", [[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[2, 0, 0], *2 * [[0, 0, 0]]]]
)
def test_a_face_as_thin_as_a_line_has_its_edges(line):
    points = np.array([[0.5, 1, 0], [3, 0, 0], [-1, 1, 1]])
    place, face = closest_points(points, np.array(line), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(place, [[0.5, 0, 0], [2, 0, 0], [0, 0, 0]], atol=1e-6)
    assert face.tolist() == [0, 0, 0]


def test_a_face_without_any_extent_is_a_point():
    place, _ = closest_points(np.eye(3), np.ones((3, 3)), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(place, np.ones((3, 3)), atol=1e-6)


def test_points_are_close_to_what_is_kilometres_away():
    place, _ = closest_points(np.array([[5000.0, 0, 0]]), np.eye(3), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(place, [[1, 0, 0]], atol=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("nowhere", [np.nan, np.inf, -np.inf])
def test_a_point_that_is_nowhere_leaves_others_as_they_are(nowhere):
    points = np.array([[nowhere, 0, 0], [0.2, 0.2, 0.5], [0, nowhere, 0]])
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    place, face = closest_points(points, triangle, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(place[1], [0.2, 0.2, 0], atol=1e-6)
    assert face.tolist() == [0, 0, 0]


def test_no_points_are_close_to_nothing():
    place, face = closest_points(np.zeros((0, 3)), np.eye(3), np.array([[0, 1, 2]]))
    assert place.shape == (0, 3)
    assert face.shape == (0,)


@pytest.mark.parametrize("least_cosine", [-1.1, 0.0, 0.7])
def test_closest_points_on_what_faces_the_same_way_are_those_of_a_loop_over_faces(least_cosine):
    rng = np.random.default_rng(3)
    soup = rng.uniform(-1, 1, (60, 1, 3)) + rng.normal(0, 0.2, (60, 3, 3))
    faces = np.arange(180).reshape(60, 3)
    points = rng.uniform(-1, 1, (50, 3))
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    reach = 0.6
    face, weights = closest_facing(
        points, normals, soup.reshape(-1, 3), faces, reach_m=reach, least_cosine=least_cosine
    )
    across = np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
    facing = normals @ (across / np.linalg.norm(across, axis=1, keepdims=True)).T > least_cosine
    nearest = np.stack([trimesh.triangles.closest_point(soup, [p] * 60) for p in points])
    away = np.where(facing, np.linalg.norm(nearest - points[:, None], axis=2), np.inf)
    found = away.min(axis=1) < reach
    np.testing.assert_array_equal(face, np.where(found, away.argmin(axis=1), -1))
    assert 0 < found.sum() < 50 or least_cosine < 0
    made = np.einsum("pc,pci->pi", weights[found], soup[face[found]])
    np.testing.assert_allclose(made, nearest[found, face[found]], atol=1e-5)
