import igl
import numpy as np
import pytest
import trimesh
import warp as wp

from drapeline.geometry.closest_lanes import rows_in_order
from drapeline.geometry.lanes import INDICES
from drapeline.geometry.ray_lanes import windings_in_lanes
from drapeline.geometry.warp_mesh import start_warp, warp_mesh
from drapeline.seeding import rng_for
from toys.rays import rays_clear_of_edges

_MANY = 60  # patches


@wp.kernel
def _wind(
    surface: wp.uint64,
    rows: wp.array(dtype=INDICES),
    points: wp.array(dtype=wp.vec3),
    way: wp.vec3,
    windings: wp.array(dtype=int),
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
