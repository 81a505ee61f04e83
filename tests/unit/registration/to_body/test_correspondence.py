"""Body vertices matched with a garment that was laid on them."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_edges, faces_within
from drapeline.registration.to_body.correspondence import BodyMesh, correspond
from drapeline.registration.to_body.registrar import round_trip
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


def values(measures):
    return {m.metric: m.value for m in measures}


def test_a_patch_covers_what_lies_under_it_and_its_rim_is_met(body):
    vertices, mesh = body
    laid, triangles = flat_sheet(10, 10, 0.02, -0.0837, -0.0911)
    garment = laid + [0, 0, 0.05]
    match = correspond(vertices, mesh, laid, triangles)
    inside = ((vertices[:, :2] > laid.min(0)[:2]) & (vertices[:, :2] < laid.max(0)[:2])).all(1)
    assert match.mask[inside].all()
    # Rounding to the nearest vertex keeps the mask within half an edge of the patch.
    out = np.maximum(laid.min(0) - vertices, vertices - laid.max(0))[:, :2].max(1)
    assert out[match.mask].max() <= 0.006
    offsets = match.offsets(garment, vertices)
    rebuilt = (vertices + offsets)[match.mask]
    for axis in (0, 1):  # drawn onto the boundary exactly
        assert rebuilt[:, axis].min() == pytest.approx(laid[:, axis].min(), abs=1e-6)
        assert rebuilt[:, axis].max() == pytest.approx(laid[:, axis].max(), abs=1e-6)
    assert not offsets[~match.mask].any()
    found = values(round_trip(garment, triangles, vertices, mesh.faces, match))
    assert found["garment_to_rebuilt_mean_mm"] < 0.05
    assert found["area_lost_percent"] == 0
    assert found["holes_after"] == found["islands_after"] == 0


def test_points_are_barycentric_and_follow_the_garment(body):
    vertices, mesh = body
    laid, triangles = flat_sheet(10, 10, 0.02, -0.09, -0.09)
    match = correspond(vertices, mesh, laid, triangles)
    np.testing.assert_allclose(match.bary[match.mask].sum(1), 1, atol=1e-5)
    assert (match.bary >= 0).all()
    linear = laid @ np.array([[2.0, 0, 0], [0, 1, 1], [0, 0, 1]]) + [1, 2, 3]
    flat = match.points(laid)
    expected = flat @ np.array([[2.0, 0, 0], [0, 1, 1], [0, 0, 1]]) + [1, 2, 3]
    np.testing.assert_allclose(match.points(linear)[match.mask], expected[match.mask], atol=1e-5)


def test_cloth_that_faces_the_other_way_is_not_taken(body):
    vertices, mesh = body
    laid, triangles = flat_sheet(10, 10, 0.02, -0.09, -0.09)
    assert not correspond(vertices, mesh, laid, triangles[:, ::-1]).mask.any()
    above = np.concatenate([laid + [0, 0, 0.012], laid + [0, 0, 0.004]])
    both = np.concatenate([triangles, triangles[:, ::-1] + len(laid)])
    match = correspond(vertices, mesh, above, both)
    assert (match.corner[match.mask] < len(laid)).all()


def test_a_hole_is_counted_and_filled(body):
    vertices, mesh = body
    laid, triangles = flat_sheet(12, 12, 0.02, -0.11, -0.11)
    triangles = triangles[np.abs(laid[triangles].mean(1)).max(1) > 0.03]
    match = correspond(vertices, mesh, laid, triangles)
    assert match.holes == 1
    assert mesh.holes(match.mask) == 0
    found = values(round_trip(laid, triangles, vertices, mesh.faces, match))
    assert (found["holes_before"], found["holes_after"]) == (1, 0)
    assert found["garment_to_rebuilt_mean_mm"] < 1


def test_an_island_is_counted_and_dropped(body):
    vertices, mesh = body
    laid, triangles = flat_sheet(8, 8, 0.02, -0.15, -0.15)
    other, more = flat_sheet(3, 3, 0.02, 0.1, 0.1)
    match = correspond(
        vertices, mesh, np.concatenate([laid, other]), np.concatenate([triangles, more + len(laid)])
    )
    assert match.islands == 1
    assert (match.corner[match.mask] < len(laid)).all()


def test_two_fronts_side_by_side_stay_apart(body):
    vertices, mesh = body
    left, triangles = flat_sheet(8, 12, 0.02, -0.14, -0.11)
    right, _ = flat_sheet(8, 12, 0.02, 0.0, -0.11)
    yoke, band = flat_sheet(15, 3, 0.02, -0.14, 0.11)
    laid = np.concatenate([left, right, yoke])
    # The fronts are sewn to the yoke above them, not to one another.
    sewn = np.arange(len(laid))
    sewn[192:199], sewn[199:207] = np.arange(88, 95), np.arange(184, 192)
    sewn[95] = 184
    faces = sewn[np.concatenate([triangles, triangles + 96, band + 192])]
    match = correspond(vertices, mesh, laid, faces)
    kept = faces_within(mesh.faces, match.mask)
    from_left = (match.corner[kept] < 88).all(-1)  # (F, 3)
    from_right = ((match.corner[kept] > 95) & (match.corner[kept] < 184)).all(-1)
    assert not (from_left.any(1) & from_right.any(1)).any()
    fronts = (np.abs(vertices[:, 0]) < 0.1) & (np.abs(vertices[:, 1]) < 0.1)
    assert match.mask[fronts].mean() > 0.9
    found = values(round_trip(laid, faces, vertices, mesh.faces, match))
    assert found["holes_after"] == 0
    assert found["area_lost_percent"] < 0.5
