"""Edges, boundaries and normals of a tube of quads."""

import numpy as np
import pytest

from drapeline.geometry.mesh import (
    barycentric,
    boundary_edges,
    boundary_loops,
    edge_counts,
    edge_graph,
    edge_lengths,
    edges,
    face_edges,
    face_normals,
    faces_within,
    half_edges,
    mean_edge_length,
    triangulate,
    vertex_normals,
)


def tube(rings=4, around=6):
    """An open cylinder of quads: unit radius, axis Z, outward orientation."""
    angle = 2 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)
    vertices = np.concatenate(
        [np.column_stack([circle, np.full(around, float(k))]) for k in range(rings)]
    )
    here = np.arange(around)
    there = (here + 1) % around
    faces = np.concatenate(
        [
            np.stack([here, there, there + around, here + around], 1) + k * around
            for k in range(rings - 1)
        ]
    )
    return vertices.astype(np.float32), faces.astype(np.int32)


def test_edges_of_a_tube_obey_euler():
    vertices, faces = tube()
    assert len(vertices) - len(edges(faces)) + len(faces) == 0
    _, counts = edge_counts(faces)
    assert np.bincount(counts).tolist() == [0, 12, 30]


def test_boundary_loops_of_a_tube_are_its_two_ends_in_order():
    _, faces = tube()
    loops = boundary_loops(faces)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [
        [0, 1, 2, 3, 4, 5],
        list(range(18, 24)),
    ]
    steps = np.abs(np.diff(loops[0]))
    assert set(steps.tolist()) <= {1, 5}


def test_two_loops_through_one_vertex_are_refused():
    faces = np.array([[0, 1, 2], [0, 3, 4]])
    with pytest.raises(ValueError, match="vertex 0 lies on more than one"):
        boundary_loops(faces)


def test_rim_edges_of_a_tube_are_those_of_its_loops():
    _, faces = tube()
    boundary = boundary_edges(faces)
    loops = boundary_loops(faces)
    assert set(boundary.ravel()) == set(np.concatenate(loops))
    assert len(boundary) == sum(map(len, loops))


def test_faces_within_a_mask_have_all_their_corners_in_it():
    vertices, faces = tube()
    mask = vertices[:, 2] < 0.5 * vertices[:, 2].max()
    kept = faces_within(faces, mask)
    assert mask[kept].all()
    assert 0 < len(kept) == mask[faces].all(axis=1).sum() < len(faces)


def test_normals_of_a_tube_point_outward():
    vertices, faces = tube(around=64)
    triangles = triangulate(faces)
    normals = vertex_normals(vertices, triangles)
    outward = vertices * [1, 1, 0]
    np.testing.assert_allclose(normals, outward, atol=0.06)
    centres = vertices[triangles].mean(1) * [1, 1, 0]
    assert (np.einsum("fi,fi->f", face_normals(vertices, triangles), centres) > 0.9).all()


def test_a_quad_splits_as_cloth3d_readers_do():
    assert triangulate(np.array([[4, 5, 6, 7]])).tolist() == [[4, 5, 6], [4, 6, 7]]


def test_the_graph_of_a_tube_joins_each_vertex_to_its_neighbours_both_ways():
    vertices, faces = tube()
    graph = edge_graph(edges(faces), len(vertices)).toarray()
    np.testing.assert_array_equal(graph, graph.T)
    assert np.flatnonzero(graph[6]).tolist() == [0, 7, 11, 12]
    assert set(graph.ravel()) == {0, 1}


def test_half_edges_run_around_their_face():
    assert half_edges(np.array([[4, 5, 6]])).tolist() == [[4, 5], [5, 6], [6, 4]]


def test_faces_know_their_edges():
    _, faces = tube()
    pairs, which = face_edges(faces)
    np.testing.assert_array_equal(pairs, edges(faces))
    assert which.shape == faces.shape
    ends = np.sort(half_edges(faces), axis=1).reshape(*faces.shape, 2)
    np.testing.assert_array_equal(pairs[which], ends)


def test_edge_lengths_of_a_rectangle():
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0], [0, 4, 0]])
    assert edge_lengths(vertices, np.array([[0, 2], [1, 2]])).tolist() == [5, 4]
    assert mean_edge_length(vertices, np.array([[0, 1, 2, 3]])) == 3.5


def test_normals_of_faces_without_area_are_zero():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert not face_normals(vertices, np.array([[0, 1, 2]])).any()


def test_barycentric_shares_give_the_points_back():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(50, 3, 3))
    shares = rng.dirichlet(np.ones(3), 50)
    points = (corners * shares[..., None]).sum(1)
    np.testing.assert_allclose(barycentric(points, corners), shares, atol=1e-9)
    flat = np.zeros((1, 3, 3))
    assert np.isfinite(barycentric(np.zeros((1, 3)), flat)).all()
