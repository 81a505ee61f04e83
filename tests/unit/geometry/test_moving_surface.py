import igl
import numpy as np
import pytest
import trimesh

from drapeline.geometry.moving_surface import MovingSurface
from drapeline.seeding import rng_for


def slow_location(points, vertices, faces):
    """By libigl: squared distances, and winding numbers over all faces."""
    vertices = vertices.astype(np.float64)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    squared = igl.point_mesh_squared_distance(points, vertices, faces)[0]
    return np.sqrt(squared), igl.winding_number(vertices, faces, points) > 0.5


def agree(surface, points, vertices, faces):
    distance, inside = surface.locate(points)
    expected, within = slow_location(points, vertices, faces)
    assert within.any()
    assert not within.all()
    np.testing.assert_allclose(distance, expected, atol=1e-5)
    np.testing.assert_array_equal(inside, within)


def ball(centre=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    return np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces)


@pytest.fixture
def points():
    return rng_for(1, "points").uniform(-0.6, 0.6, (3000, 3))


def test_distance_and_side_of_a_ball_that_moves(points):
    vertices, faces = ball()
    surface = MovingSurface(vertices, faces)
    agree(surface, points, vertices, faces)
    moved = vertices * [1.2, 1, 0.5] + [0.1, 0, 0.05]
    surface.move(moved)
    agree(surface, points, moved, faces)


def test_what_lies_in_two_limbs_is_inside(points):
    """Also where the nearest surface is one limb's, seen from outside, within the other."""
    (one, faces), (two, _) = ball(), ball((0.25, 0, 0))
    vertices, faces = np.concatenate([one, two]), np.concatenate([faces, faces + len(one)])
    agree(MovingSurface(vertices, faces), points, vertices, faces)


def test_holes_count_as_closed(points):
    """Winding numbers of a surface with a hole are fractions, and cross a half at the hole."""
    vertices, faces = ball()
    cap = (vertices[faces, 2] > 0.29).all(axis=1)
    assert cap.any()
    holed = faces[~cap]
    near_hole = np.linalg.norm(points - [0, 0, 0.3], axis=1) < 0.1
    agree(MovingSurface(vertices, holed), points[~near_hole], vertices, holed)
    on_axis = np.array([[0.003, 0.002, 0.25], [0.003, 0.002, 0.31]])
    assert MovingSurface(vertices, holed).locate(on_axis)[1].tolist() == [True, False]


def test_a_real_shape_with_thin_limbs(toy_body):
    vertices, faces = toy_body.v_template, toy_body.faces
    near = vertices[::2] + rng_for(2, "near").normal(scale=0.02, size=vertices[::2].shape)
    agree(MovingSurface(vertices, faces), near, vertices, faces)


@pytest.mark.parametrize(
    ("apart", "reach", "folded"),
    [(0.03, 0.04, True), (0.05, 0.04, False), (-0.05, 0.04, True), (-0.2, 0.04, True)],
)
def test_folds_are_where_a_surface_faces_or_overlaps_itself(apart, reach, folded):
    (one, faces), (two, _) = ball(), ball((0.6 + apart, 0, 0))
    surface = MovingSurface(np.concatenate([one, two]), np.concatenate([faces, faces + len(one)]))
    surface.locate(np.array([[0.299, 0.001, 0.002], [-0.299, 0.001, 0.002]]))
    assert surface.in_folds(np.array([0, 1]), reach).tolist() == [folded, False]
    assert surface.in_folds(np.array([1]), reach).tolist() == [False]
    assert surface.in_folds(np.array([], int), reach).tolist() == []
