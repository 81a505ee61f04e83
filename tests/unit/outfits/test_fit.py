"""Resizing, leaving the body, laying one garment over another, on shapes with known answers."""

import numpy as np
import pytest
import trimesh

from drapeline.bodies.rest_body import signed_tightness, tightness_shape
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.fit import lay_over, leave_body, resize


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
