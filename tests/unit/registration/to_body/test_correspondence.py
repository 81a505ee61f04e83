"""Body vertices matched with a garment that was laid on them."""

import numpy as np
import pytest

from drapeline.geometry.mesh import faces_within
from drapeline.registration.to_body.body_mesh import BodyMesh
from drapeline.registration.to_body.correspondence import correspond
from drapeline.registration.to_body.round_trip import round_trip
from toys.topology import flat_sheet


@pytest.fixture(scope="module")
def body():
    vertices, faces = flat_sheet(41, 41, 0.01, -0.2, -0.2)
    return vertices, BodyMesh(faces, len(vertices))


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
