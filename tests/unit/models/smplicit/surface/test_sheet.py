import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh, boundary_loops, edge_counts, face_normals
from drapeline.metrics.garment import piece_indices
from drapeline.models.smplicit.surface.sheet import SMALLEST_OPENING_M, extract_sheet
from drapeline.models.smplicit.surface.walls import Grid, extract_walls
from drapeline.seeding import rng_for
from toys.open_surfaces import AnalyticField, four_openings, half_sphere, open_tube

CELL_M, THRESHOLD_M = 0.008, 0.0055
SURFACES = pytest.mark.parametrize(
    ("surface", "openings"), [(open_tube, 2), (half_sphere, 1), (four_openings, 4)]
)


def away(points):
    """Away from the nearest bone of a body that consists of the axes of x and z."""
    limb = np.hypot(points[:, 1], points[:, 2]) - 0.06 < np.hypot(*points[:, :2].T) - 0.1
    ways = points * np.where(limb[:, None], [0, 1, 1], [1, 1, 0])
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def walls_of(field, threshold_m=THRESHOLD_M):
    grid = Grid(np.array([-0.3, -0.15, -0.25]), np.array([0.3, 0.15, 0.25]), CELL_M)
    return extract_walls(field, grid, threshold_m)


def outward(surface, points):
    return (
        points / np.linalg.norm(points, axis=1)[:, None] if surface is half_sphere else away(points)
    )


def sheet_of(surface, *, error_m=0.0, threshold_m=THRESHOLD_M):
    field = AnalyticField(surface, error_m=error_m)
    walls = walls_of(field, threshold_m)
    return extract_sheet(field, walls, threshold_m, outward(surface, walls.vertices))


def turned_faces(sheet, surface):
    """Faces that look inwards, or away from a neighbour by more than 120 degrees."""
    normals = face_normals(sheet.vertices.astype(np.float64), sheet.faces)
    inwards = (normals * outward(surface, sheet.vertices[sheet.faces].mean(axis=1))).sum(1) < 0
    half = np.sort(np.stack([sheet.faces, np.roll(sheet.faces, -1, 1)], -1).reshape(-1, 2), axis=1)
    order = np.lexsort(half.T)
    same = np.flatnonzero((half[order[1:]] == half[order[:-1]]).all(axis=1))
    first, second = order[same] // 3, order[same + 1] // 3
    return inwards.sum() + ((normals[first] * normals[second]).sum(1) < -0.5).sum()


@SURFACES
def test_a_single_open_surface_where_the_cloth_is(surface, openings):
    sheet = sheet_of(surface)
    assert len(boundary_loops(sheet.faces)) == openings
    assert piece_indices(sheet).max() == 0
    assert edge_counts(sheet.faces)[1].max() == 2
    # A sphere with that many openings: no handles are left over from the walls.
    edge_count = len(edge_counts(sheet.faces)[0])
    assert len(sheet.vertices) - edge_count + len(sheet.faces) == 2 - openings
    distance = surface(sheet.vertices.astype(np.float64))
    assert distance.mean() < 0.0005
    assert distance.max() < 0.005  # the seam where sleeves begin is rounded off
    assert turned_faces(sheet, surface) == 0
    assert sheet.vertices.dtype == np.float32
    assert sheet.faces.dtype == np.int32


def test_hems_are_where_the_cloth_ends_and_smooth():
    sheet = sheet_of(open_tube)
    for loop in boundary_loops(sheet.faces):
        hem = sheet.vertices[loop].astype(np.float64)
        np.testing.assert_allclose(np.abs(hem[:, 2]), 0.15, atol=0.0015)
        np.testing.assert_allclose(np.linalg.norm(hem[:, :2], axis=1), 0.12, atol=0.0015)
        sides = np.diff(np.concatenate([hem, hem[:1]]), axis=0)
        assert np.linalg.norm(sides, axis=1).sum() == pytest.approx(2 * np.pi * 0.12, rel=0.02)


@pytest.mark.parametrize("error_m", [-0.002, 0.0015])
def test_fields_that_are_off_by_a_constant_give_the_same_place(error_m):
    sheet = sheet_of(open_tube, error_m=error_m, threshold_m=0.0065)
    within = np.abs(sheet.vertices[:, 2]) < 0.13
    distance = open_tube(sheet.vertices[within].astype(np.float64))
    assert distance.max() < abs(error_m) / 2
    assert len(boundary_loops(sheet.faces)) == 2


@SURFACES
def test_wrong_directions_here_and_there_change_little(surface, openings):
    field = AnalyticField(surface)
    walls = walls_of(field)
    ways = outward(surface, walls.vertices)
    clean = extract_sheet(field, walls, THRESHOLD_M, ways)
    random = rng_for(0, "ways")
    ways[random.random(len(ways)) < 0.25] *= -1  # single vertices
    ways[np.linalg.norm(walls.vertices - [0, 0.1, 0.1], axis=1) < 0.025] *= -1  # a whole spot
    sheet = extract_sheet(field, walls, THRESHOLD_M, ways)
    assert len(boundary_loops(sheet.faces)) == openings
    assert abs(len(sheet.vertices) - len(clean.vertices)) < 0.03 * len(clean.vertices)


def test_the_order_of_the_walls_vertices_does_not_matter():
    field = AnalyticField(four_openings)
    walls = walls_of(field)
    sheet = extract_sheet(field, walls, THRESHOLD_M, away(walls.vertices))
    order = rng_for(0, "order").permutation(len(walls.vertices))
    place = np.argsort(order)
    shuffled = Mesh(walls.vertices[order], place[walls.faces][::-1])
    other = extract_sheet(field, shuffled, THRESHOLD_M, away(shuffled.vertices))
    assert len(other.vertices) == pytest.approx(len(sheet.vertices), rel=0.002)
    np.testing.assert_allclose(
        np.sort(other.vertices[:, 2])[[0, -1]], np.sort(sheet.vertices[:, 2])[[0, -1]], atol=2e-4
    )


def test_holes_too_small_for_an_opening_are_closed():
    def torn(points):  # the field is too high in a spot, so that its walls have a hole there
        away_m = np.linalg.norm(points - [0, -0.12, 0], axis=1)
        return open_tube(points) + 0.008 * np.exp(-((away_m / 0.015) ** 2))

    field = AnalyticField(torn)
    walls = walls_of(field)
    handles = 1 - (len(walls.vertices) - len(walls.faces) // 2) // 2
    assert handles == 2  # the tube's own and the hole
    sheet = extract_sheet(field, walls, THRESHOLD_M, away(walls.vertices))
    loops = boundary_loops(sheet.faces)
    assert len(loops) == 2
    for loop in loops:
        hem = sheet.vertices[loop]
        assert np.linalg.norm(hem - np.roll(hem, 1, axis=0), axis=1).sum() > SMALLEST_OPENING_M
    assert open_tube(sheet.vertices.astype(np.float64)).max() < 0.006


def test_loose_bits_are_left_out():
    def with_bit(points):
        bit = np.abs(np.linalg.norm(points - [0.22, 0, 0], axis=1) - 0.02)
        return np.minimum(open_tube(points), bit)

    sheet = sheet_of(with_bit)
    assert piece_indices(sheet).max() == 0
    assert sheet.vertices[:, 0].max() < 0.13


def test_few_gradients_and_two_distances_per_vertex():
    field = AnalyticField(four_openings)
    walls = walls_of(field)
    field.asked = 0
    sheet = extract_sheet(field, walls, THRESHOLD_M, away(walls.vertices))
    assert field.asked == len(walls.vertices) + len(sheet.vertices)
    assert 0 < field.asked_gradients < 0.15 * len(sheet.vertices)


def test_walls_of_nothing_and_walls_that_look_nowhere_outwards_give_no_faces():
    field = AnalyticField(half_sphere)
    walls = walls_of(field)
    sheet = extract_sheet(field, walls, THRESHOLD_M, np.zeros_like(walls.vertices))
    assert sheet.vertices.shape == sheet.faces.shape == (0, 3)
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert extract_sheet(field, none, THRESHOLD_M, np.zeros((0, 3))).faces.shape == (0, 3)
