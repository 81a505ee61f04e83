import igl
import numpy as np
import pytest
import trimesh
import warp as wp

from drapeline.geometry.lanes import LaneInts
from drapeline.geometry.surface_lanes import find_closest_in_lanes, rows_in_order, windings_in_lanes
from drapeline.geometry.warp_mesh import start_warp, warp_mesh
from drapeline.seeding import rng_for
from toys.rays import rays_clear_of_edges

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


_MANY = 60  # patches


@wp.kernel
def _wind(
    surface: wp.uint64,
    rows: wp.array[LaneInts],
    points: wp.array[wp.vec3],
    way: wp.vec3,
    windings: wp.array[int],
):
    windings_in_lanes(surface, rows, wp.tid(), points, way, windings)


def wind(points, vertices, faces, way):
    """How often a surface winds around points (P, 3), by rays along a way."""
    start_warp()
    mesh = warp_mesh(vertices, np.asarray(faces))
    rows = rows_in_order(len(points))
    places = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
    found = wp.full(len(points), 7, dtype=int, device="cpu")
    inputs = [mesh.id, rows, places, wp.vec3(*(np.array(way) / np.linalg.norm(way)))]
    wp.launch(_wind, dim=len(rows), inputs=inputs, outputs=[found], device="cpu")
    return found.numpy()


def slow_windings(points, vertices, faces, way):
    """By libigl, and for which points rounding decides nothing, neither theirs nor their rays'."""
    vertices = np.ascontiguousarray(vertices, dtype=np.float64)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    clear = igl.point_mesh_squared_distance(points, vertices, faces)[0] > 1e-8
    clear &= rays_clear_of_edges(points, np.array(way), vertices[faces])
    return np.round(igl.winding_number(vertices, faces, points)), clear


@pytest.fixture
def limbs():
    """Two balls that overlap, and a third inside out: vertices and faces."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    turned = trimesh.Trimesh(ball.vertices * 0.4 + [-0.5, 0.1, 0], ball.faces[:, ::-1])
    parts = [ball, ball.copy().apply_translation([0.25, 0.01, 0.02]), turned]
    return trimesh.util.append_faces([p.vertices for p in parts], [p.faces for p in parts])


@pytest.mark.parametrize(
    "way", [(1, 2, 3), (-3, 1, 2), (2, -3, 1), (0, 0, 1), (0, -1, 0), (-1, 0, 0), (1e-9, 1, -1)]
)
def test_windings_are_those_of_a_slow_sum_whatever_the_way(limbs, way):
    points = rng_for(1, "points").uniform(-0.65, 0.65, (_MANY * 8 - 3, 3))
    expected, clear = slow_windings(points, *limbs, way)
    assert set(expected) == {-1, 0, 1, 2}
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(wind(points, *limbs, way)[clear], expected[clear])


def test_windings_around_points_near_to_a_real_shape(toy_body):
    """Points of a patch lie far apart here, and the rays of most go through the shape."""
    vertices, faces = toy_body.v_template, toy_body.faces
    points = rng_for(2, "near").permutation(vertices)[: _MANY * 8]
    points = points + rng_for(3, "near").normal(scale=0.02, size=points.shape)
    way = (2, 1, -1)
    expected, clear = slow_windings(points, vertices, faces, way)
    assert set(expected) == {0, 1}
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(wind(points, vertices, faces, way)[clear], expected[clear])


def test_rays_meet_what_is_before_them_alone():
    triangle = np.array([[0.0, 0, 0], [3, 0, 0], [1, 2, 0]])
    points = np.array([[1, 0.5, -0.1], [1, 0.5, 0.1], [9, 9, -0.1]])
    up, down = ((0.0, 0.0, sign) for sign in (1.0, -1.0))
    assert wind(points, triangle, [[0, 1, 2]], up).tolist() == [1, 0, 0]
    assert wind(points, triangle, [[0, 1, 2]], down).tolist() == [0, -1, 0]
    assert wind(points, triangle, [[0, 1, 1]], up).tolist() == [0, 0, 0]
