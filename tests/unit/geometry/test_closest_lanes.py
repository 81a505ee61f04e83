import igl
import numpy as np
import pytest
import warp as wp

from drapeline.geometry.closest_lanes import find_closest_in_lanes, rows_in_order
from drapeline.geometry.warp_mesh import start_warp, warp_mesh
from drapeline.seeding import rng_for

TRIANGLE = np.array([[0.0, 0, 0], [3, 0, 0], [1, 2, 0]])


def search(points, vertices, faces, reaches=1e3):
    """Faces (P,) and weights (P, 3) found, -7 and 7 where nothing is."""
    start_warp()
    count = len(points)
    mesh = warp_mesh(vertices, np.asarray(faces))
    found = wp.full(count, -7, dtype=int, device="cpu")
    weights = wp.full(count, 7.0, dtype=wp.vec3, device="cpu")
    rows = rows_in_order(count)
    inputs = [
        *(mesh.id, rows, wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")),
        wp.array(np.broadcast_to(reaches, count).astype(np.float32), dtype=float, device="cpu"),
    ]
    outputs = [found, weights]
    wp.launch(find_closest_in_lanes, len(rows), inputs, outputs, device="cpu")
    return found.numpy(), weights.numpy()


def places(vertices, faces, found, weights):
    return np.einsum("pki,pk->pi", vertices[faces[found]], weights)


def test_the_closest_point_of_a_triangle_in_all_its_regions():
    """Above it, past each of its edges and past each of its corners."""
    points = rng_for(1, "points").uniform([-3, -3, -2], [6, 5, 2], (4001, 3))
    faces = np.array([[0, 1, 2]])
    found, weights = search(points, TRIANGLE, faces)
    squared, _, closest = igl.point_mesh_squared_distance(points, TRIANGLE, faces)
    assert (found == 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert weights.min() > -1e-6
    np.testing.assert_allclose(places(TRIANGLE, faces, found, weights), closest, atol=2e-5)
    regions = {tuple(row) for row in (weights > 1e-5).tolist()}
    assert len(regions) == 7
    assert squared.max() > 9


def test_distances_to_a_real_shape_are_exact(toy_body):
    vertices, faces = toy_body.v_template, toy_body.faces
    points = rng_for(2, "near").normal(vertices, 0.05)
    found, weights = search(points, vertices, faces)
    squared, *_ = igl.point_mesh_squared_distance(
        points, vertices.astype(np.float64), np.ascontiguousarray(faces, dtype=np.int64)
    )
    away = np.linalg.norm(points - places(vertices, faces, found, weights), axis=1)
    np.testing.assert_allclose(away, np.sqrt(squared), atol=1e-6)


@pytest.mark.parametrize("count", [1, 7, 8, 9])
def test_points_of_a_row_are_searched_as_far_as_each_asks(count):
    points = np.tile([1.0, 0.5, 0.25], (count, 1))
    reaches = np.where(np.arange(count) % 3 == 0, 0.26, np.arange(count) % 3 * 0.12)
    reaches[-1] = 0.0
    found, weights = search(points, TRIANGLE, [[0, 1, 2]], reaches)
    within = reaches > 0.25
    assert found.tolist() == np.where(within, 0, -7).tolist()
    assert (weights[~within] == 7).all()


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_a_face_without_area_comes_after_its_neighbours(order):
    """Its edges are theirs too."""
    vertices = np.concatenate([TRIANGLE, [[1.5, 0, 0], [1.5, 0, 0]]])
    faces = np.array([[0, 1, 3], [3, 4, 3], [0, 1, 2]])[order]
    found, _ = search(np.array([[1.5, -0.1, 0.0]]), vertices, faces)
    assert found.tolist() == [order.index(2)]


def test_of_a_point_that_is_nowhere_nothing_is_found():
    points = np.array([[np.nan, 0, 0], [1.0, 0.5, 0.25]])
    found, _ = search(points, TRIANGLE, [[0, 1, 2]])
    assert found.tolist() == [-7, 0]
