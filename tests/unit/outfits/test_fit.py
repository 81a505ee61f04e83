"""Resizing, leaving the body, laying one garment over another, on shapes with known answers."""

import numpy as np
import pytest
import trimesh

from drapeline.bodies.rest_body import signed_tightness, tightness_shape
from drapeline.geometry.mesh import edge_lengths, edges
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.fit import (
    drape,
    drape_on_form,
    lay_on,
    lay_over,
    leave_body,
    resize,
    seed_folds,
)
from drapeline.seeding import rng_for


def tube(radius, *, low=-0.5, high=0.5, around=40, rows=30):
    """Vertices and quads of an upright open cylinder."""
    angle = 2 * np.pi * np.arange(around) / around
    height = np.linspace(low, high, rows)
    points = np.stack(
        [
            np.tile(radius * np.cos(angle), (rows, 1)),
            np.tile(radius * np.sin(angle), (rows, 1)),
            np.repeat(height[:, None], around, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    ids = np.arange(rows * around).reshape(rows, around)
    after = np.roll(ids, -1, axis=1)
    return points, np.stack([ids[:-1], after[:-1], after[1:], ids[1:]], axis=-1).reshape(-1, 4)


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    return np.array(mesh.vertices), np.array(mesh.faces)


@pytest.fixture(scope="module")
def solid(ball):
    return SignedDistance(*ball)


@pytest.mark.parametrize(("gender", "sign"), [("female", -1.0), ("male", 1.0)])
def test_the_first_tightness_term_carries_the_sign_of_the_gender(gender, sign):
    np.testing.assert_array_equal(signed_tightness([0.4, -1.2], gender), [sign * 0.4, -1.2])
    shape = np.arange(10.0)
    target = tightness_shape(shape, [0.4, -1.2], gender)
    np.testing.assert_allclose(target[:2], [sign * 0.4, 1 - 1.2])
    np.testing.assert_array_equal(target[2:], shape[2:])
    assert shape[0] == 0  # the wearer's own shape is left alone


def test_what_is_held_lies_on_a_ball_and_cloth_far_from_it_stays(solid):
    points, _ = tube(0.33)
    held = np.abs(points[:, 2]) < 0.02
    moved = lay_on(points, solid, held, 0.004)
    distance, _ = solid.query(moved)
    np.testing.assert_allclose(distance[held], 0.004, atol=5e-4)
    far = np.abs(points[:, 2]) > 0.1
    np.testing.assert_array_equal(moved[far], points[far])
    near = ~held & (np.abs(points[:, 2]) < 0.06)
    assert (distance[near] < solid.query(points)[0][near] + 1e-9).all()
    np.testing.assert_array_equal(lay_on(points, solid, np.zeros(len(points), bool), 0.0), points)


def test_a_collar_moves_with_the_neckline(solid):
    points, _ = tube(0.33, rows=31)
    rows = np.arange(len(points)).reshape(31, -1)
    held = np.isin(np.arange(len(points)), rows[15])
    moved = lay_on(points, solid, held, 0.004, rows[15:18]) - points
    expected = np.repeat(moved[rows[15]][None], 2, axis=0)
    np.testing.assert_allclose(moved[rows[16:18]], expected, atol=1e-12)


def test_cloth_leaves_a_ball_by_the_gap_and_elsewhere_stays(solid):
    points, faces = tube(0.29)
    average = averaging_matrix(faces, len(points))
    moved = leave_body(points, average, solid, 0.005)
    distance, _ = solid.query(moved)
    assert distance.min() >= 0.005 - 1e-5
    far = np.abs(points[:, 2]) > 0.4
    np.testing.assert_array_equal(moved[far], points[far])


def test_cloth_outside_is_left_alone(solid):
    points, faces = tube(0.4)
    moved = leave_body(points, averaging_matrix(faces, len(points)), solid, 0.005)
    np.testing.assert_array_equal(moved, points)


def test_resizing_follows_a_uniform_move_exactly(ball):
    points, faces = tube(0.32)
    average = averaging_matrix(faces, len(points))
    shift = np.array([0.01, -0.02, 0.03])
    moved = resize(points, average, ball[0], ball[0] + shift, 20)
    np.testing.assert_allclose(moved, points + shift, atol=1e-12)


def test_resizing_filters_the_body_s_detail(ball):
    points, faces = tube(0.32)
    average = averaging_matrix(faces, len(points))
    rough = np.random.default_rng(0).normal(scale=0.01, size=ball[0].shape)
    moved = resize(points, average, ball[0], ball[0] + rough, 60)
    assert np.linalg.norm(moved - points, axis=1).mean() < 0.004


@pytest.mark.parametrize("radius", [0.18, 0.2, 0.21])
def test_the_outer_layer_clears_the_inner_one(radius):
    inner, _ = tube(0.2, low=-0.5, high=0.0)
    points, faces = tube(radius, low=-0.2, high=0.4)
    moved = lay_over(points, averaging_matrix(faces, len(points)), inner, 0.0, 0.006)
    around = np.hypot(moved[:, 0], moved[:, 1])
    assert around[moved[:, 2] < 0].min() >= 0.2 + 0.005
    np.testing.assert_allclose(moved[:, 2], points[:, 2])
    assert around[moved[:, 2] > 0.3] == pytest.approx(radius)


EDGE_M = 0.025


def test_settling_keeps_off_the_form_and_holds_the_waist(garments, templates):
    form = templates.form
    for name in ("Trousers", "Tshirt", "Dress"):
        pattern = garments[name][0]
        points = drape_on_form(rng_for(1, name), form, pattern, EDGE_M, 0.01)
        high = points[:, 2] > form.landmarks["waist"]
        value = np.where(high, form.upper.value(points), form.lower.value(points))
        assert value.min() > 0.003
        assert np.linalg.norm(points - pattern.vertices, axis=1).max() < 0.06
        if name == "Trousers":
            waist = pattern.marks["waist"]
            np.testing.assert_array_equal(points[waist], pattern.vertices[waist])


@pytest.fixture(scope="module")
def sheet():
    """A square of 11 x 11 vertices, edges of 2 cm, hanging in the plane y = 0: vertices, faces."""
    z, x = np.divmod(np.arange(121.0), 11)
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.stack([corner, corner + 1, corner + 12, corner + 11], axis=1)
    return 0.02 * np.column_stack([x, 0 * x, z]), faces


def settled(sheet, **changes):
    vertices, faces = sheet
    count = len(vertices)
    options = {"fullness": np.zeros(count), "nudge": np.zeros((count, 3)), "steps": 30}
    held = vertices[:, 2] > 0.19
    return drape(vertices, faces, held, lambda p: p, **{**options, **changes}), held


def test_a_sheet_hangs_from_what_is_held_and_hardly_stretches(sheet):
    out, held = settled(sheet)
    np.testing.assert_array_equal(out[held], sheet[0][held])
    fall = (sheet[0] - out)[:, 2]
    assert 0 < fall[:11].mean() < 0.01
    pairs = edges(sheet[1])
    np.testing.assert_allclose(edge_lengths(out, pairs), 0.02, rtol=0.1)


def test_fullness_lengthens_the_weft_and_deepens_the_folds_that_are_seeded(sheet):
    nudge = seed_folds(rng_for(0, "folds"), sheet[1], 121, 0.02, 2e-4)
    fullness = np.full(121, 0.05)
    plain, held = settled(sheet, nudge=nudge)
    full, _ = settled(sheet, nudge=nudge, fullness=fullness)
    weft = np.stack([np.arange(10), np.arange(1, 11)], axis=1)
    lengths = [edge_lengths(out, weft).sum() for out in (plain, full)]
    assert 1.02 < lengths[1] / lengths[0] < 1.06
    deep, shallow = (np.abs(out[~held, 1]).mean() for out in (full, plain))
    assert deep > 1.25 * shallow
    unseeded, _ = settled(sheet, fullness=fullness)
    assert not unseeded[:, 1].any()


def test_nothing_passes_what_keeps_it_out(sheet):
    vertices, faces = sheet
    nudge = np.tile([0.0, 0.01, 0.0], (121, 1))
    none = np.zeros(121, dtype=bool)
    out = drape(
        vertices,
        faces,
        none,
        lambda p: np.maximum(p, [-1, 0.005, -1]),
        fullness=np.zeros(121),
        nudge=nudge,
        steps=5,
    )
    assert out[:, 1].min() >= 0.005


def test_seeds_of_folds_have_their_size_and_run_along_the_warp(sheet):
    noise = seed_folds(rng_for(0, "folds"), sheet[1], 121, 0.02, 0.003).reshape(11, 11, 3)
    assert np.sqrt((noise**2).mean()) == pytest.approx(0.003)
    along, around = (np.abs(np.diff(noise, axis=axis)).mean() for axis in (0, 1))
    assert along < 0.6 * around
