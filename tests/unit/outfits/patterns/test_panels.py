"""Panels: grids of quads, and their texture laid flat."""

import numpy as np
import pytest

from drapeline.geometry.mesh import triangulate
from drapeline.outfits.patterns.panels import BETWEEN_FRONTS_M, BETWEEN_LEGS_M, Pattern, separator

NAMES = ("Tshirt", "polo", "open", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress")


@pytest.mark.parametrize("name", NAMES)
def test_texture_panels_lie_flat_without_overlaps(garments, name):
    uv, uv_faces = garments[name][0].texture()
    assert uv.min() >= 0
    assert uv.max() <= 1
    corners = uv[triangulate(uv_faces)].astype(np.float64)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    assert area.min() > 0
    # Rasterised: no sample of the square lies in two triangles.
    size = 300
    covered = np.zeros((size, size), dtype=int)
    for triangle, twice in zip(corners, area, strict=True):
        low = np.floor(triangle.min(axis=0) * size - 0.5).astype(int) + 1
        high = np.floor(triangle.max(axis=0) * size - 0.5).astype(int) + 1
        x, y = (np.arange(low[k], high[k]) for k in (0, 1))
        p = (np.stack(np.meshgrid(x, y, indexing="ij"), -1) + 0.5) / size
        along, to = np.roll(triangle, -1, axis=0) - triangle, p[..., None, :] - triangle
        sides = (along[:, 0] * to[..., 1] - along[:, 1] * to[..., 0]) / twice
        covered[np.ix_(x, y)] += (sides > 1e-9).all(axis=-1)
    assert covered.max() == 1
    assert covered.mean() > 0.25


@pytest.fixture
def sheet():
    """A panel of 3 x 4 vertices, 2 cm wide and 1 cm high, with a corner cut out."""
    pattern = Pattern()
    y, x = np.divmod(np.arange(12.0), 4)
    ids = pattern.add_vertices(np.column_stack([0.02 * x, 0 * x, 0.01 * y]).reshape(3, 4, 3))
    ids[2, 3] = -1
    pattern.add_panel(ids, 0)
    return pattern, ids


def test_vertices_are_numbered_in_the_order_they_are_added():
    pattern = Pattern()
    first, second = pattern.add_vertices(np.zeros((2, 3))), pattern.add_vertices(np.ones((2, 2, 3)))
    assert first.tolist() == [0, 1]
    assert second.tolist() == [[2, 3], [4, 5]]
    assert pattern.count == 6
    np.testing.assert_array_equal(pattern.vertices[:, 0], [0, 0, 1, 1, 1, 1])


def test_a_cell_is_a_quad_where_all_its_corners_exist(sheet):
    faces = sheet[0].faces()
    assert faces.tolist() == [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [4, 5, 9, 8], [5, 6, 10, 9]]
    assert faces.dtype == np.int32


def test_a_flat_panel_keeps_its_proportions_in_the_texture(sheet):
    pattern, ids = sheet
    uv, uv_faces = pattern.texture()
    np.testing.assert_array_equal(uv_faces, pattern.faces())
    step = np.diff(uv[ids[:2]], axis=1)
    np.testing.assert_allclose(step[..., 0], step[0, 0, 0], rtol=1e-5)
    np.testing.assert_allclose(step[..., 1], 0, atol=1e-7)
    along = uv[ids[1, 0]] - uv[ids[0, 0]]
    np.testing.assert_allclose(along, [0, step[0, 0, 0] / 2], atol=1e-6)


def test_the_two_legs_of_trousers_stay_apart(garments):
    pattern = garments["Trousers"][0]
    points = pattern.vertices
    assert points[pattern.marks["left_leg"], 0].min() > 0.003
    assert points[pattern.marks["right_leg"], 0].max() < -0.003


def test_legs_are_put_back_on_their_own_side():
    marks = {"left_leg": np.array([0, 1]), "right_leg": np.array([2])}
    points = np.array([[0.2, 1, 1], [-0.1, 1, 1], [0.0, 1, 1], [0.0, 1, 1]])
    out = separator(Pattern(marks=marks))(points)
    np.testing.assert_allclose(out[:, 0], [0.2, BETWEEN_LEGS_M, -BETWEEN_LEGS_M, 0])
    np.testing.assert_array_equal(out[:, 1:], 1)
    closer = separator(Pattern(marks=marks), 0.001)(np.zeros((4, 3)))
    np.testing.assert_allclose(closer[:, 0], [0.001, 0.001, -0.001, 0])


def test_fronts_give_way_by_half_of_what_is_lacking_each():
    right, left = [0, 1], [2, 3]
    points = np.zeros((4, 3))
    points[left, 0] = [-0.002, 0.02]
    out = separator(Pattern(marks={"placket": np.array([*right, *left])}))(points)
    assert np.isclose(out[2, 0] - out[0, 0], BETWEEN_FRONTS_M)
    assert np.isclose(out[2, 0] + out[0, 0], -0.002)
    np.testing.assert_array_equal(out[[1, 3], 0], [0, 0.02])


def test_garments_without_legs_and_fronts_stay():
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_array_equal(separator(Pattern())(points.copy()), points)
