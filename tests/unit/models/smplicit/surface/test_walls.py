import numpy as np
import pytest
from skimage.measure import marching_cubes

from drapeline.errors import InputError
from drapeline.geometry.mesh import boundary_edges, edge_counts
from drapeline.models.smplicit.surface.walls import Grid, extract_walls
from drapeline.seeding import rng_for
from toys.open_surfaces import AnalyticField, four_openings, half_sphere, open_tube


def far_point(points):
    return np.linalg.norm(points - [5.0, 0, 0], axis=1)


def ball(points):
    return np.linalg.norm(points - [0.013, -0.007, 0.021], axis=1)


def around(low, high, cell_m):
    return Grid(np.array(low), np.array(high), cell_m)


def shirt_grid(cell_m):
    return around([-0.3, -0.15, -0.25], [0.3, 0.15, 0.25], cell_m)


def dense(field, grid, threshold_m):
    """The slow twin: the field at every point."""
    counts = [n + 1 for n in grid.cells]
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    values = field.distances(grid.places(index).astype(np.float32)).reshape(counts)
    vertices, faces, _, _ = marching_cubes(values, threshold_m, gradient_direction="descent")
    return grid.places(vertices).astype(np.float32), faces


def euler_number(mesh):
    return len(mesh.vertices) - len(edge_counts(mesh.faces)[0]) + len(mesh.faces)


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return np.einsum("fi,fi->", a, np.cross(b, c)) / 6


def test_the_grid_starts_at_its_low_corner_and_reaches_the_high_one():
    grid = around([-1, 0, 2], [1, 0.25, 2.1], 0.1)
    assert grid.cells == (20, 3, 1)
    np.testing.assert_allclose(grid.places(np.array([[0, 0, 0], [20, 3, 1]]))[0], [-1, 0, 2])
    np.testing.assert_allclose(grid.places(np.array([[20, 3, 1.5]]))[0], [1, 0.3, 2.15])


def test_a_sphere_lies_where_it_is_and_is_as_large_as_it_is():
    field = AnalyticField(ball, clip_m=0.2)
    walls = extract_walls(field, around([-0.11] * 3, [0.13] * 3, 0.004), 0.08)
    radius = ball(walls.vertices)
    np.testing.assert_allclose(radius, 0.08, atol=1e-4)
    np.testing.assert_allclose(walls.vertices.mean(axis=0), [0.013, -0.007, 0.021], atol=2e-4)
    assert volume(walls) == pytest.approx(4 / 3 * np.pi * 0.08**3, rel=2e-3)


@pytest.mark.parametrize("surface", [open_tube, half_sphere, four_openings])
@pytest.mark.parametrize("cell_m", [0.006, 0.008, 0.011, 0.024])  # every 8, 6, 4, 2 points
def test_the_same_mesh_as_on_the_full_grid(surface, cell_m):
    field = AnalyticField(surface)
    threshold_m = max(0.7 * cell_m, 0.0055)
    walls = extract_walls(field, shirt_grid(cell_m), threshold_m)
    vertices, faces = dense(field, shirt_grid(cell_m), threshold_m)
    np.testing.assert_array_equal(walls.vertices, vertices)
    np.testing.assert_array_equal(walls.faces, faces)


def test_points_deep_within_the_walls_are_not_taken_for_outside():
    field = AnalyticField(open_tube, clip_m=0.1)
    grid = around([-0.25] * 3, [0.25] * 3, 0.004)
    walls = extract_walls(field, grid, 0.06)
    vertices, faces = dense(field, grid, 0.06)
    np.testing.assert_array_equal(walls.vertices, vertices)
    np.testing.assert_array_equal(walls.faces, faces)


@pytest.mark.parametrize("slope", [0.6, 1.8])
def test_the_field_may_be_steeper_or_less_steep_than_a_distance(slope):
    field = AnalyticField(lambda points: slope * open_tube(points))
    grid = shirt_grid(0.006)
    walls = extract_walls(field, grid, 0.006)
    np.testing.assert_array_equal(walls.vertices, dense(field, grid, 0.006)[0])


def test_a_twentieth_of_the_full_grids_evaluations():
    field = AnalyticField(lambda points: 2 * four_openings(points / 2))  # a t-shirt 1 m wide
    grid = around([-0.8] * 3, [0.8] * 3, 1.6 / 256)
    walls = extract_walls(field, grid, 0.005)
    assert len(walls.vertices) > 50_000
    assert field.asked < 257**3 / 20


def test_a_field_that_tells_less_is_looked_at_more_often():
    asked = {}
    for clip_m in (0.01, 0.02, 0.03):
        field = AnalyticField(open_tube, clip_m=clip_m)
        walls = extract_walls(field, shirt_grid(0.006), 0.005)
        np.testing.assert_array_equal(walls.vertices, dense(field, shirt_grid(0.006), 0.005)[0])
        asked[clip_m] = field.asked - 101 * 51 * 85  # of the full grid
    assert asked[0.01] > asked[0.02] > asked[0.03]


@pytest.mark.parametrize(
    ("surface", "euler"), [(open_tube, 0), (half_sphere, 2), (four_openings, -4)]
)
def test_walls_are_closed_and_look_away_from_the_cloth(surface, euler):
    walls = extract_walls(AnalyticField(surface), shirt_grid(0.008), 0.0055)
    assert not len(boundary_edges(walls.faces))
    assert euler_number(walls) == euler  # 2 - 2 handles, of which there is one less than loops
    assert volume(walls) > 0


def test_sheets_of_any_direction_have_no_holes():
    for number, way in enumerate(rng_for(0, "ways").normal(size=(12, 3))):
        way /= np.linalg.norm(way)
        middle = 0.0007 * number * np.array([1, 0.6, 0.3])

        def disc(points, way=way, middle=middle):
            height = (points - middle) @ way
            aside = np.linalg.norm(points - middle - height[:, None] * way, axis=1)
            return np.hypot(height, np.maximum(aside - 0.05, 0))

        grid = around([-0.08] * 3, [0.08] * 3, 0.008)
        assert euler_number(extract_walls(AnalyticField(disc), grid, 0.65 * 0.008)) == 2


def test_nothing_near_gives_no_faces():
    walls = extract_walls(AnalyticField(far_point), shirt_grid(0.008), 0.0055)
    assert walls.vertices.shape == walls.faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("threshold_m", "message"),
    [
        (0.004, "the threshold is 4 mm, too small for cells of 8 mm; expected at least 0.55 cells"),
        (0.03, "the threshold is 30 mm; expected less than the 30 mm"),
        (0.05, "the threshold is 50 mm; expected less than the 30 mm"),
    ],
)
def test_unusable_thresholds_are_refused(threshold_m, message):
    field = AnalyticField(open_tube)
    with pytest.raises(InputError, match=message):
        extract_walls(field, shirt_grid(0.008), threshold_m)
    assert not field.asked
