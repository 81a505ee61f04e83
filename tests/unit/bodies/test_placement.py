"""Motions placed on the floor, and how well they meet it."""

import numpy as np
import pytest

from drapeline.bodies.placement import ground_contact, leg_length_m, place_on_floor


def test_path_is_scaled_by_leg_length():
    vertices = np.zeros((3, 2, 3))
    vertices[:, 1, 2] = -0.9
    trans = np.array([[5.0, 6, 0.6], [6, 6, 0.6], [5, 8, 0.8]])
    path = place_on_floor(vertices, trans, 1.5)
    np.testing.assert_allclose(path[0, :2], [5, 6])
    np.testing.assert_allclose(np.diff(path, axis=0), 1.5 * np.diff(trans, axis=0))
    assert path[:, 2].min() == pytest.approx(0.9)


def test_ground_numbers_of_a_known_slide():
    """A foot on the floor that moves 1 cm per frame slides at 0.3 m/s; the other is in the air."""
    vertices = np.zeros((5, 2, 3))
    vertices[:, 0, 0] = 0.01 * np.arange(5)
    vertices[:, 1, 2] = 0.3
    trans = np.zeros((5, 3))
    trans[:, 2] = [0, -0.002, 0, 0, 0]
    ground = ground_contact(vertices, trans, [np.array([0]), np.array([1])])
    assert ground.foot_sliding_m_s == pytest.approx(0.3)
    assert ground.penetration_m == pytest.approx(0.002)
    assert ground.mean_penetration_m == pytest.approx(0.0004)


def test_leg_length_of_the_toy(toy_body):
    assert leg_length_m(toy_body, np.zeros(10)) == pytest.approx(0.79, abs=0.005)
