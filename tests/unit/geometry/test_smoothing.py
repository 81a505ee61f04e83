"""Fairing against its dense twin, and what it takes out and leaves."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_edges, edges, triangulate
from drapeline.geometry.smoothing import averaging_matrix, fairing
from drapeline.seeding import rng_for
from tiny_sample import tube

AROUND, ROWS = 16, 41


@pytest.fixture(scope="module")
def cloth():
    """A tube of 40 rows, and the row of each vertex."""
    mesh = tube(0.2, -0.5, 0.5, AROUND, ROWS)
    row = np.unique(np.round(mesh.vertices[:, 2], 6), return_inverse=True)[1]
    return mesh.vertices.astype(np.float64), mesh.faces, row


def evened(faces, values):
    return fairing(faces, averaging_matrix(faces, len(values)), 30.0)(values)


def test_it_is_the_minimum_of_its_energy(cloth):
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
        found = fairing(faces, averaging_matrix(faces, count), strength)(given)
        expected = np.linalg.solve(np.eye(count) + strength * away.T @ away, given)
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_what_is_straight_keeps_its_place_and_rims_are_not_drawn_in(cloth):
    vertices, faces, _ = cloth
    found = evened(faces, vertices)
    np.testing.assert_allclose(found[:, 2], vertices[:, 2], atol=1e-9)


@pytest.mark.parametrize(("rows", "low", "high"), [(4, 0.0, 0.15), (7.3, 0.4, 0.6), (20, 0.95, 1)])
def test_folds_of_few_edges_go_and_wide_ones_stay(cloth, rows, low, high):
    vertices, faces, row = cloth
    fold = 0.01 * np.sin(2 * np.pi * row / rows)
    left = evened(faces, vertices[:, 0] + fold) - evened(faces, vertices[:, 0])
    inner = (row > 10) & (row < ROWS - 11)
    assert low <= np.dot(left[inner], fold[inner]) / np.dot(fold[inner], fold[inner]) <= high


def test_triangles_and_quads_have_the_rims_they_have(cloth):
    vertices, faces, _ = cloth
    found = evened(triangulate(faces), vertices)
    np.testing.assert_allclose(found[:, 2].min(), vertices[:, 2].min(), atol=2e-3)
