"""Masks on a flat sheet: pieces, holes, borders."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_edges, faces_within
from drapeline.registration.to_body.body_mesh import BodyMesh
from toys.topology import flat_sheet


@pytest.fixture(scope="module")
def body():
    vertices, faces = flat_sheet(41, 41, 0.01, -0.2, -0.2)
    return vertices, BodyMesh(faces, len(vertices))


def test_the_mask_is_one_piece_with_simple_borders(body):
    vertices, mesh = body
    rng = np.random.default_rng(0)
    mask = rng.random(len(vertices)) < 0.75
    cleaned = mesh.clean(mask, np.zeros(len(mask), dtype=bool))
    assert mesh.islands(cleaned) == 0
    boundary = boundary_edges(faces_within(mesh.faces, cleaned))
    assert np.bincount(boundary.ravel()).max() <= 2


def test_holes_are_counted_by_pieces(body):
    vertices, mesh = body
    mask = np.ones(len(vertices), dtype=bool)
    assert mesh.holes(mask) == 0
    mask[np.linalg.norm(vertices - [0.1, 0, 0], axis=1) < 0.03] = False
    mask[np.linalg.norm(vertices + [0.1, 0, 0], axis=1) < 0.03] = False
    mask[np.linalg.norm(vertices - [0.2, 0.2, 0], axis=1) < 0.05] = False  # at the open end
    assert mesh.holes(mask) == 2


def test_islands_are_the_pieces_besides_the_largest(body):
    vertices, mesh = body
    near = [np.linalg.norm(vertices - place, axis=1) < 0.04 for place in ([0, 0, 0], [0.1, 0, 0])]
    assert mesh.islands(near[0]) == 0
    assert mesh.islands(near[0] | near[1]) == 1
    assert mesh.islands(np.zeros(len(vertices), dtype=bool)) == 0


def test_cleaning_fills_holes_but_for_slits_that_lead_to_an_opening(body):
    vertices, mesh = body
    mask = np.abs(vertices[:, :2]).max(axis=1) < 0.101
    none = np.zeros(len(mask), dtype=bool)
    hole = np.linalg.norm(vertices, axis=1) < 0.025
    np.testing.assert_array_equal(mesh.clean(mask & ~hole, none), mask)
    slit = (np.abs(vertices[:, 0]) < 0.001) & (vertices[:, 1] > -0.001) & mask
    cleaned = mesh.clean(mask, slit)
    np.testing.assert_array_equal(cleaned, mask & ~slit)
    # A slit that ends inside is a hole, and is filled.
    inside = slit & (vertices[:, 1] < 0.05)
    np.testing.assert_array_equal(mesh.clean(mask, inside), mask)


def test_spacing_is_the_mean_length_of_a_vertex_s_edges(body):
    vertices, mesh = body
    spacing = mesh.spacing(vertices).reshape(41, 41)
    # Four edges of 1 cm and two diagonals.
    np.testing.assert_allclose(spacing[1:-1, 1:-1], 0.01 * (4 + 2 * np.sqrt(2)) / 6)
    assert mesh.spacing(np.zeros_like(vertices)).max() == 0


def test_ends_are_the_body_s_own_boundary(body):
    vertices, mesh = body
    expected = np.abs(vertices[:, :2]).max(axis=1) > 0.199
    np.testing.assert_array_equal(mesh.ends, expected)
    mask = vertices[:, 0] < 0.001
    border = mesh.border(mask)
    np.testing.assert_array_equal(border, (expected & mask) | (np.abs(vertices[:, 0]) < 0.001))
