"""The rest pose that garments are made in, and tightness."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.model import free_body, load_body, posed_vertices
from drapeline.bodies.rest_body import (
    body_mass_index,
    rest_body,
    rest_to_pose,
    sample_shape,
    shape_of_bmi,
    signed_tightness,
    tightness_shape,
)
from drapeline.frames import GENDERS, JOINT_NAMES, REST_POSE
from drapeline.seeding import rng_for


def test_shapes_are_uniform_and_reproducible(toy_body):
    shapes = np.array([sample_shape(rng_for(0, "shape", i), toy_body, 3.0) for i in range(2000)])
    assert shapes.shape == (2000, 10)
    assert np.abs(shapes).max() <= 3
    np.testing.assert_allclose(shapes.mean(axis=0), 0, atol=0.2)
    np.testing.assert_allclose(shapes.std(axis=0), 3 / np.sqrt(3), rtol=0.05)
    np.testing.assert_array_equal(shapes[5], sample_shape(rng_for(0, "shape", 5), toy_body, 3.0))


@pytest.mark.parametrize("gender", GENDERS)
def test_body_mass_indices_are_those_that_are_asked_for(gender):
    """Of the free bodies; their logarithm is uniform, and only corpulence differs."""
    body = load_body(free_body(gender))
    rng, same = rng_for(0, "bmi"), rng_for(0, "bmi")
    plain = sample_shape(same, body, 3.0)
    shapes = [sample_shape(rng, body, 3.0, (16, 45)) for _ in range(60)]
    np.testing.assert_array_equal(np.delete(shapes[0], 1), np.delete(plain, 1))
    found = np.array([body_mass_index(body, shape) for shape in shapes])
    assert 16 <= found.min() < 18
    assert 40 < found.max() <= 45
    assert np.median(found) == pytest.approx(np.sqrt(16 * 45), rel=0.15)


def test_body_mass_index_is_mass_over_squared_height(toy_body):
    """A body twice as large has twice the index."""
    twice = replace(toy_body, v_template=2 * toy_body.v_template, shapedirs=2 * toy_body.shapedirs)
    index = body_mass_index(toy_body, SHAPE)
    assert 15 < index < 40
    assert body_mass_index(twice, SHAPE) == pytest.approx(2 * index)


def test_an_index_out_of_reach_is_approached(toy_body):
    shapes = [shape_of_bmi(toy_body, SHAPE, bmi) for bmi in (1.0, 1e4)]
    thin, fat = (body_mass_index(toy_body, shape) for shape in shapes)
    assert thin < body_mass_index(toy_body, SHAPE) < fat


SHAPE = np.linspace(-1, 1, 10)


def test_the_rest_body_stands_upright_with_its_legs_apart(toy_body):
    vertices = rest_body(toy_body, SHAPE)
    assert vertices.dtype == np.float64
    _, joints = posed_vertices(toy_body, SHAPE, REST_POSE[None])
    places = dict(zip(JOINT_NAMES, joints[0], strict=True))
    np.testing.assert_allclose(places["pelvis"], 0, atol=1e-6)
    assert np.ptp(vertices[:, 2]) > 1.5
    legs = [places[f"{side}_ankle"] - places[f"{side}_hip"] for side in ("left", "right")]
    for leg, sign in zip(legs, (1, -1), strict=True):
        assert np.arctan2(leg[0], -leg[2]) == pytest.approx(sign * 0.15, abs=0.01)


def test_the_rest_pose_moves_nothing(toy_body):
    motions = rest_to_pose(toy_body, SHAPE, REST_POSE[None])
    np.testing.assert_allclose(motions[0], np.tile(np.eye(3, 4), (24, 1, 1)), atol=1e-12)


def test_a_turned_root_turns_all_parts_about_the_root(toy_body):
    turned = REST_POSE.copy()
    turned[:3] = [0.4, -1.0, 0.7]
    motions = rest_to_pose(toy_body, SHAPE, turned[None])[0]
    whole = axis_angle_to_matrix(turned[:3]) @ axis_angle_to_matrix(REST_POSE[:3]).T
    np.testing.assert_allclose(motions[..., :3], np.tile(whole, (24, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(motions[..., 3], 0, atol=1e-12)


@pytest.mark.parametrize(("gender", "first"), [("female", -0.5), ("male", 0.5)])
def test_tightness_changes_two_coefficients_with_the_sign_of_the_gender(gender, first):
    np.testing.assert_allclose(signed_tightness([0.5, -1.0], gender), [first, -1.0])
    target = tightness_shape(SHAPE, np.array([0.5, -1.0]), gender)
    np.testing.assert_allclose(target - SHAPE, [first, -1.0, *[0] * 8], atol=1e-12)
