import igl
import numpy as np
import pytest
import trimesh

from drapeline.geometry.mesh import vertex_normals
from drapeline.geometry.moving_surface import MovingSheet
from drapeline.seeding import rng_for

REACH_M = 0.03


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces).astype(np.int64)


def slow_beneath(points, vertices, faces):
    """By libigl, in double precision."""
    squared, face, closest = igl.point_mesh_squared_distance(points, vertices, faces)
    away = points - closest
    normal = vertex_normals(vertices, faces)[faces[face]].mean(axis=1)
    side = np.einsum("pi,pi->p", away, normal)
    return (squared < REACH_M**2) & (side < -0.5 * np.linalg.norm(away, axis=1))


@pytest.mark.parametrize(("radius", "share"), [(1.01, 0.0), (0.99, 1.0), (1.2, 0.0), (0.9, 0.0)])
def test_what_is_within_a_ball_and_near_it_is_beneath(ball, radius, share):
    vertices, faces = ball
    beneath = MovingSheet(vertices, faces).beneath(radius * vertices, REACH_M)
    assert beneath.mean() == pytest.approx(share, abs=0.01)


def test_what_is_past_an_open_edge_is_not_beneath(ball):
    vertices, faces = ball
    bowl = faces[(vertices[faces, 2] < 0).all(axis=1)]
    rim = vertices[(np.abs(vertices[:, 2]) < 0.1)]
    above = 0.99 * rim + [0, 0, 0.2]
    assert not MovingSheet(vertices, bowl).beneath(above, 0.5).any()


def test_it_agrees_with_libigl_on_an_open_sheet_that_moves(ball):
    vertices, faces = ball
    sheet = faces[(vertices[faces, 2] < 0.7).all(axis=1)]
    moving = MovingSheet(vertices, sheet)
    moved = vertices * [0.4, 0.3, 0.5] + [0.1, 0.2, 0.0]
    moving.move(moved)
    points = moved + rng_for(1, "points").normal(scale=0.02, size=moved.shape)
    expected = slow_beneath(points, moved, sheet)
    assert 0.2 < expected.mean() < 0.8
    np.testing.assert_array_equal(moving.beneath(points, REACH_M), expected)
