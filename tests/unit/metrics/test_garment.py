"""Metrics against shapes whose answer is known, and against slow twins."""

import igl
import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh, faces_within
from drapeline.metrics.garment import (
    BodyInside,
    area_distances_mm,
    distances_mm,
    garment_measures,
    garment_mesh,
    inside_measures,
    largest_piece,
    mask_iou,
    mesh_measures,
    normal_error_deg,
    piece_count,
    piece_indices,
    shape_measures,
    surface_distances_mm,
    surface_error_mm,
)
from drapeline.seeding import rng_for


def cylinder(radius, height=(0.0, 1.0), around=48, up=25):
    """Open tube: vertices (around * up, 3) and outward triangles."""
    angle = 2 * np.pi * np.arange(around) / around
    z = np.linspace(*height, up)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    vertices = np.concatenate([np.tile(ring, (up, 1)), np.repeat(z, around)[:, None]], axis=1)
    i, j = np.divmod(np.arange(around * (up - 1)), around)
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate(
        [np.stack([a, b, b + around], -1), np.stack([a, b + around, a + around], -1)]
    )
    return vertices, faces


@pytest.fixture
def tube():
    return cylinder(0.2)


def test_surface_error_is_the_mean_length_within_the_true_mask(tube):
    vertices, _ = tube
    mask = np.zeros(len(vertices), dtype=bool)
    mask[:10] = True
    moved = vertices.copy()
    moved[:10] += [0.003, 0.004, 0.0]
    moved[10:] += 7  # outside the mask nothing counts
    assert surface_error_mm(moved, vertices, mask) == pytest.approx(5.0)


@pytest.mark.parametrize("angle_deg", [0.0, 25.0, 180.0])
def test_normal_error_is_the_angle_of_a_turn(angle_deg):
    rng = rng_for(0, "normals")
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [3, 0, 0], [2, 1, 0]], float)
    angle = np.radians(angle_deg)
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    turned = flat @ turn.T
    turned[3:] += rng.normal(size=3)
    mask = np.ones(6, dtype=bool)
    assert normal_error_deg(turned, flat, faces, mask) == pytest.approx(angle_deg, abs=1e-5)
    mask[5] = False  # the second face is no garment any more
    turned[3:] = rng.normal(size=(3, 3))
    assert normal_error_deg(turned, flat, faces, mask) == pytest.approx(angle_deg, abs=1e-5)


def test_normal_errors_of_faces_are_averaged_as_angles():
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]] * 2, float)
    turned = flat.copy()
    for corners, angle in ((slice(0, 3), np.radians(10)), (slice(3, 6), np.radians(80))):
        turned[corners, 2] = flat[corners, 1] * np.sin(angle)
        turned[corners, 1] *= np.cos(angle)
    mask = np.ones(6, dtype=bool)
    assert normal_error_deg(turned, flat, faces, mask) == pytest.approx(45)


def test_a_face_without_area_counts_as_a_right_angle(tube):
    vertices, faces = tube
    mask = np.ones(len(vertices), dtype=bool)
    assert normal_error_deg(np.zeros_like(vertices), vertices, faces, mask) == 90.0


def test_mask_iou_counts():
    predicted = np.array([1, 1, 1, 0, 0], dtype=bool)
    true = np.array([0, 1, 1, 1, 0], dtype=bool)
    assert mask_iou(predicted, true) == 0.5
    assert mask_iou(true, true) == 1.0


def test_garment_mesh_keeps_faces_with_all_corners_in_the_mask(tube):
    vertices, faces = tube
    mask = vertices[:, 2] < 0.5
    mesh = garment_mesh(vertices, faces, mask)
    assert len(mesh.faces) == len(faces_within(faces, mask))
    assert mesh.vertices[mesh.faces].max(axis=(0, 1))[2] < 0.5
    np.testing.assert_allclose(
        mesh.vertices[mesh.faces], vertices[faces_within(faces, mask)], atol=1e-6
    )
    mask[:] = False
    mask[0] = True  # a lone vertex is no garment
    assert garment_mesh(vertices, faces, mask).vertices.shape == (0, 3)


def test_pieces_are_numbered_by_size(tube):
    vertices, faces = tube
    z = vertices[:, 2]
    mesh = garment_mesh(vertices, faces, (z < 0.3) | (z > 0.45))
    piece = piece_indices(mesh)
    assert set(piece) == {0, 1}
    assert (mesh.vertices[piece == 0, 2] > 0.4).all()
    assert (mesh.vertices[piece == 1, 2] < 0.4).all()
    assert (largest_piece(mesh).vertices[:, 2] > 0.4).all()
    assert len(largest_piece(mesh).faces) < len(mesh.faces)


def test_pieces_are_counted_without_vertices_in_no_face(tube):
    vertices, faces = tube
    middle = vertices[faces][:, :, 2].mean(axis=1)
    assert piece_count(Mesh(vertices, faces)) == 1
    assert piece_count(Mesh(vertices, faces[(middle < 0.3) | (middle > 0.45)])) == 2


def test_masks_that_are_empty_have_nothing_in_common():
    assert mask_iou(np.zeros((2, 3), bool), np.zeros((2, 3), bool)) == 0
    assert mask_iou(np.eye(2, dtype=bool), np.ones((2, 2), bool)) == 0.5


def test_distances_see_what_is_missing_and_what_is_too_much_each_in_one_direction():
    whole, half = (Mesh(*cylinder(0.2, (0, top), up=up)) for top, up in ((1.0, 25), (0.5, 13)))
    to_true, to_predicted = surface_distances_mm(half, whole)
    assert to_true == pytest.approx(0, abs=1e-3)
    # Rows above the half are i / 24 metres away from its boundary.
    assert to_predicted == pytest.approx(1000 * np.arange(1, 13).sum() / 24 / 25, rel=1e-4)
    assert surface_distances_mm(whole, half) == pytest.approx((to_predicted, to_true), abs=1e-3)


def flat_sheet(height_m, cells):
    """A square metre of triangles at a height."""
    steps = np.linspace(0, 1, cells + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    i, j = np.divmod(np.arange(cells**2), cells)
    a = i * (cells + 1) + j
    right, up = a + cells + 1, a + 1
    faces = np.concatenate([np.c_[a, right, right + 1], np.c_[a, right + 1, up]])
    return Mesh(np.c_[x, y, np.full(len(x), height_m)], faces)


def test_parallel_sheets_are_as_far_off_both_ways_and_turned_by_nothing():
    found = mesh_measures(flat_sheet(0.005, cells=3), flat_sheet(0, cells=4))
    assert found.pop("openings_right") == 1
    assert found.pop("normal_error_deg") == pytest.approx(0, abs=1e-3)
    assert found == pytest.approx({"surface_to_true_mm": 5, "true_to_surface_mm": 5})


def test_openings_are_right_where_there_are_as_many(tube):
    whole, (vertices, faces) = Mesh(*tube), tube
    # Without a face in the middle there is a hole, at the lower end the hem has a notch alone.
    hole, notch = (Mesh(vertices, np.delete(faces, face, axis=0)) for face in (48 * 12, 0))
    assert mesh_measures(notch, whole)["openings_right"] == 1
    assert mesh_measures(hole, whole)["openings_right"] == 0
    assert mesh_measures(hole, hole)["openings_right"] == 1


def test_measures_of_nothing_are_nan_and_its_openings_are_wrong(tube):
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    found = mesh_measures(nothing, Mesh(*tube))
    assert found.pop("openings_right") == 0
    assert np.isnan([*found.values()]).all()


def test_distances_to_nothing_are_nan(tube):
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    assert np.isnan(surface_distances_mm(nothing, Mesh(*tube))).all()
    assert np.isnan(area_distances_mm(nothing, Mesh(*tube))).all()


def test_area_distances_see_what_is_cut_off_between_vertices():
    # Vertices of a prism of six sides lie on the tube of its radius, the rest of it does not.
    tube, prism = Mesh(*cylinder(0.2, around=720)), Mesh(*cylinder(0.2, around=6))
    along = np.linspace(-0.1, 0.1, 100_001)
    expected = 1000 * (0.2 - np.hypot(along, 0.2 * np.sqrt(0.75))).mean()
    to_true, _ = area_distances_mm(prism, tube)
    assert to_true == pytest.approx(expected, rel=0.01)
    assert surface_distances_mm(prism, tube)[0] == pytest.approx(0, abs=1e-3)


def test_area_distances_do_not_depend_on_where_vertices_are_dense():
    bent = np.r_[np.linspace(0, 0.5, 6), np.linspace(0.5, 1.0, 51)[1:]]
    found = []
    for heights in (np.linspace(0, 1, 21), bent):
        cone, faces = cylinder(0.2, up=len(heights))
        cone[:, 2] = np.repeat(heights, 48)
        cone[:, :2] *= 1 + 0.1 * cone[:, 2:]
        found.append(area_distances_mm(Mesh(cone, faces), Mesh(*cylinder(0.2, around=720)))[0])
    assert found[0] == pytest.approx(found[1], rel=1e-2)


@pytest.mark.parametrize(("depth_m", "deep"), [(0.005, 0.0), (0.02, 0.5)])
def test_inside_measures_of_a_sunken_garment(depth_m, deep):
    body, faces = cylinder(0.2, (-1, 2), around=400, up=40)  # open at both ends, as our body is
    outside, _ = cylinder(0.21)
    sunken, _ = cylinder(0.2 - depth_m)
    found = inside_measures(np.concatenate([outside, sunken]), body, faces)
    assert found["inside_share"] == 0.5
    assert found["inside_1cm_share"] == deep
    assert found["inside_depth_mm"] == pytest.approx(1000 * depth_m, rel=0.02)
    assert (BodyInside(body, faces).depth(outside) == 0).all()


def test_shape_measures_without_a_garment_are_nan_and_no_piece(tube):
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    found = shape_measures(nothing, *tube)
    assert found["pieces"] == 0
    assert np.isnan(found["inside_share"])


def test_a_perfect_prediction_is_perfect(tube):
    vertices, faces = tube
    mask = vertices[:, 2] < 0.7
    found = garment_measures(vertices, mask, vertices, mask, faces)
    assert found["mask_iou"] == 1
    for name in set(found) - {"mask_iou"}:
        assert found[name] == pytest.approx(0, abs=1e-4), name


def test_without_a_mask_there_is_no_metric_of_it(tube):
    vertices, faces = tube
    mask = vertices[:, 2] < 0.7
    found = garment_measures(vertices + [0.001, 0, 0], None, vertices, mask, faces)
    assert set(found) == {"surface_error_mm", "normal_error_deg"}
    assert found["surface_error_mm"] == pytest.approx(1)


def test_depths_equal_those_of_libigl(toy_body):
    """The short cut before the winding numbers loses no point, in armpits and crotch neither."""
    body = toy_body.v_template.astype(np.float64)
    faces = toy_body.faces.astype(np.int64)
    points = body[::2] + rng_for(0, "about the body").normal(0, 0.02, (len(body[::2]), 3))
    inside = igl.fast_winding_number(body, faces, points) > 0.5
    distance = np.sqrt(igl.point_mesh_squared_distance(points, body, faces)[0])
    assert 0.3 < inside.mean() < 0.7
    np.testing.assert_allclose(
        BodyInside(body, faces).depth(points), np.where(inside, distance, 0), atol=1e-6
    )
    mesh = Mesh(body, faces)
    np.testing.assert_allclose(distances_mm(points, mesh), 1000 * distance, atol=1e-3)
