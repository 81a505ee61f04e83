"""Neighbour averages, smoothing and fairing of a tube and of a sheet."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_edges, edge_lengths, edges, triangulate
from drapeline.geometry.smoothing import (
    averaging_matrix,
    blur,
    cotangent_laplacian,
    equalise_edges,
    fairing,
    fill_dents,
    smooth,
    spread_pushes,
    uniform_laplacian,
)
from drapeline.seeding import rng_for
from toys.tiny_sample import tube

AROUND, ROWS = 16, 41


@pytest.fixture(scope="module")
def cloth():
    """A tube of 40 rows, and the row of each vertex."""
    mesh = tube(0.2, -0.5, 0.5, AROUND, ROWS)
    row = np.unique(np.round(mesh.vertices[:, 2], 6), return_inverse=True)[1]
    return mesh.vertices.astype(np.float64), mesh.faces, row


def remove_bumps(faces, values):
    return fairing(faces, len(values), 30.0)(values)


def test_fairing_is_the_minimum_of_its_energy(cloth):
    vertices, faces, _ = cloth
    count = len(vertices)
    given = vertices + rng_for(0, "fairing").normal(0, 0.01, vertices.shape)
    boundary = {tuple(pair) for pair in boundary_edges(faces).tolist()}
    on_boundary = {end for pair in boundary for end in pair}
    near = [[] for _ in range(count)]
    for a, b in edges(faces).tolist():
        if a not in on_boundary or (a, b) in boundary:
            near[a].append(b)
        if b not in on_boundary or (a, b) in boundary:
            near[b].append(a)
    away = np.eye(count)
    for vertex, around in enumerate(near):
        away[vertex, around] = -1 / len(around)
    for strength in (0.5, 30.0):
        found = fairing(faces, count, strength)(given)
        expected = np.linalg.solve(np.eye(count) + strength * away.T @ away, given)
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_what_is_straight_keeps_its_place_and_boundaries_are_not_drawn_in(cloth):
    vertices, faces, _ = cloth
    found = remove_bumps(faces, vertices)
    np.testing.assert_allclose(found[:, 2], vertices[:, 2], atol=1e-9)


@pytest.mark.parametrize(("rows", "low", "high"), [(4, 0.0, 0.15), (7.3, 0.4, 0.6), (20, 0.95, 1)])
def test_folds_of_few_edges_go_and_wide_ones_stay(cloth, rows, low, high):
    vertices, faces, row = cloth
    fold = 0.01 * np.sin(2 * np.pi * row / rows)
    left = remove_bumps(faces, vertices[:, 0] + fold) - remove_bumps(faces, vertices[:, 0])
    inner = (row > 10) & (row < ROWS - 11)
    assert low <= np.dot(left[inner], fold[inner]) / np.dot(fold[inner], fold[inner]) <= high


def test_triangles_and_quads_keep_the_same_boundaries(cloth):
    vertices, faces, _ = cloth
    found = remove_bumps(triangulate(faces), vertices)
    np.testing.assert_allclose(found[:, 2].min(), vertices[:, 2].min(), atol=2e-3)


@pytest.fixture(scope="module")
def sheet():
    """A square of 5 x 5 vertices with unit edges, row by row."""
    y, x = np.divmod(np.arange(25.0), 5)
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.stack([corner, corner + 1, corner + 6, corner + 5], axis=1)
    return np.column_stack([x, y, 0 * x]), faces


def test_averages_are_over_edge_neighbours_and_nothing_for_loose_vertices(sheet):
    vertices, faces = sheet
    average = averaging_matrix(faces, len(vertices) + 1).toarray()
    assert np.flatnonzero(average[12]).tolist() == [7, 11, 13, 17]
    np.testing.assert_allclose(average[2] @ np.append(vertices[:, 1], 9.0), 1 / 3)
    assert not average[25].any()


def test_averages_along_boundaries_leave_the_outline_where_it_is(sheet):
    vertices, faces = sheet
    average = averaging_matrix(faces, len(vertices), along_boundaries=True)
    moved = average @ vertices
    side = (vertices == 0).any(axis=1) & (np.abs(vertices[:, :2] - 2) < 2).any(axis=1)
    np.testing.assert_allclose(moved[side & (vertices[:, 0] == 0), 0], 0)
    np.testing.assert_allclose(moved[6:9], vertices[6:9])


def test_the_laplacian_of_a_plane_vanishes_inside(sheet):
    vertices, faces = sheet
    out = (uniform_laplacian(faces, len(vertices)) @ vertices).reshape(5, 5, 3)
    np.testing.assert_allclose(out[1:4, 1:4], 0, atol=1e-12)
    np.testing.assert_allclose(out.sum(axis=(0, 1)), 0, atol=1e-12)
    np.testing.assert_allclose(out[0, 0], [-1, -1, 0])


def test_blurring_goes_half_way_to_the_mean(sheet):
    vertices, faces = sheet
    peak = np.zeros(25)
    peak[12] = 1
    out = blur(peak, averaging_matrix(faces, len(vertices)), 1)
    assert out[12] == 0.5
    np.testing.assert_allclose(out[[7, 11, 13, 17]], 1 / 8)
    assert blur(peak, averaging_matrix(faces, len(vertices)), 0) is peak


def test_spread_pushes_reach_further_and_never_get_shorter(sheet):
    vertices, faces = sheet
    push = np.zeros((25, 3))
    push[12] = [0, 0, 2]
    out = spread_pushes(push, averaging_matrix(faces, len(vertices)), 2)
    assert (np.linalg.norm(out, axis=1) >= np.linalg.norm(push, axis=1)).all()
    np.testing.assert_array_equal(out[12], push[12])
    steps = np.abs(vertices[:, :2] - 2).sum(axis=1)
    np.testing.assert_array_equal(out[:, 2] > 0, steps <= 2)


def test_smoothing_holds_what_has_no_weight_and_flattens_the_rest(sheet):
    vertices, faces = sheet
    bumpy = vertices + [0, 0, 1] * (np.arange(25) == 12)[:, None]
    inner = ((vertices[:, :2] > 0) & (vertices[:, :2] < 4)).all(axis=1)
    average = averaging_matrix(faces, len(vertices))
    out = smooth(bumpy, average, np.where(inner, 0.5, 0.0), 100)
    np.testing.assert_array_equal(out[~inner], bumpy[~inner])
    np.testing.assert_allclose(out, vertices, atol=1e-6)
    lifted = smooth(bumpy, average, np.where(inner, 0.5, 0.0), 3, lambda p: np.maximum(p, 0.25))
    assert (lifted[inner, 2] >= 0.25).all()


def test_equalising_brings_a_vertex_to_where_its_edges_are_alike(sheet):
    vertices, faces = sheet
    free = np.arange(25) == 12
    shifted = vertices + [0.6, -0.3, 0] * free[:, None]
    out = equalise_edges(shifted, faces, free, 20)
    around = edges(faces)[(edges(faces) == 12).any(axis=1)]
    np.testing.assert_allclose(edge_lengths(out, around), 1, atol=1e-6)
    np.testing.assert_array_equal(out[~free], vertices[~free])
    kept = equalise_edges(shifted, faces, free, 20, lambda p: np.maximum(p, [2.5, 0, 0]))
    assert kept[12, 0] == 2.5


def test_the_cotangent_laplacian_of_a_flat_sheet_vanishes_but_for_its_rim():
    plane = tube(0.3, -0.4, 0.4, around=40, rows=30)
    faces = triangulate(plane.faces)
    area, stiffness = cotangent_laplacian(plane.vertices, faces)
    corners = plane.vertices[faces].astype(float)
    sides = corners[:, 1:] - corners[:, :1]
    assert area.sum() == pytest.approx(
        0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum(), rel=1e-4
    )
    np.testing.assert_allclose(stiffness.sum(axis=1), 0, atol=1e-9)
    inside = np.setdiff1d(np.arange(len(area)), boundary_edges(faces))
    # Heights along the tube are linear, and so have no curvature.
    np.testing.assert_allclose((stiffness @ plane.vertices[:, 2])[inside], 0, atol=1e-4)


def test_dents_are_filled_and_tubes_stay_as_wide():
    cloth = tube(0.3, -0.4, 0.4, around=60, rows=50)
    faces, points = triangulate(cloth.faces), cloth.vertices.astype(float)
    away = np.linalg.norm(points - [0, -0.18, 0], axis=1)
    depth = 0.03 * np.exp(-((away / 0.05) ** 2))
    dented = points + depth[:, None] * [0, 1, 0]
    filled = fill_dents(dented, faces, 0.35, 3)
    left = np.linalg.norm(filled - points, axis=1)
    assert left[depth > 0.02].mean() < 0.35 * depth[depth > 0.02].mean()
    far = away > 0.25
    np.testing.assert_allclose(filled[far], points[far], atol=4e-3)
    rim = np.unique(boundary_edges(faces))
    np.testing.assert_array_equal(filled[rim], dented[rim])
