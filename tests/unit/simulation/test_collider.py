import numpy as np
import pytest
import trimesh

from drapeline.simulation.collider import thinned_faces


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(subdivisions=4)


def test_a_ball_stays_a_closed_ball_of_fewer_triangles(ball):
    faces = thinned_faces(ball.vertices, ball.faces, 0.3)
    assert len(faces) == pytest.approx(0.3 * len(ball.faces), rel=0.02)
    coarse = trimesh.Trimesh(ball.vertices, faces, process=False)
    assert coarse.is_watertight
    # Corners lie on the ball, so its volume is a little smaller and outward.
    assert 0.98 * ball.volume < coarse.volume < ball.volume


def test_vertices_without_faces_are_never_corners(ball):
    apart = np.concatenate([np.zeros((7, 3)), ball.vertices])
    faces = thinned_faces(apart, ball.faces + 7, 0.5)
    assert faces.min() >= 7
    moved = faces - 7
    assert np.array_equal(moved, thinned_faces(ball.vertices, ball.faces, 0.5))


def test_an_open_edge_stays_open(ball):
    half = ball.faces[(ball.triangles_center[:, 2] < 0)]
    faces = thinned_faces(ball.vertices, half, 0.5)
    assert ball.vertices[faces][:, :, 2].max() < 0.1
    assert len(trimesh.Trimesh(ball.vertices, faces, process=False).outline().entities) == 1


def test_the_whole_body_is_kept_as_it_is(ball):
    assert thinned_faces(ball.vertices, ball.faces, 1.0) is ball.faces


def test_a_boundary_that_touches_itself_is_kept_as_it_is(ball):
    """Two caps that share one vertex: no manifold, so nothing may contract there."""
    top = int(ball.vertices[:, 2].argmax())
    vertices = np.concatenate([ball.vertices, -ball.vertices + 2 * ball.vertices[top]])
    cap = ball.faces[ball.triangles_center[:, 2] > 0.5]
    other = cap[:, ::-1] + len(ball.vertices)
    other[other == top + len(ball.vertices)] = top
    faces = np.concatenate([cap, other])
    found = thinned_faces(vertices, faces, 0.5)
    assert len(found)
    assert np.isin(found, faces).all()
