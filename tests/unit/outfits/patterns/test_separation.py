"""Legs and fronts keep to their sides."""

import numpy as np

from drapeline.outfits.patterns.panels import Pattern
from drapeline.outfits.patterns.separation import BETWEEN_FRONTS_M, BETWEEN_LEGS_M, separator


def test_the_two_legs_of_trousers_stay_apart(garments):
    pattern = garments["Trousers"][0]
    points = pattern.vertices
    assert points[pattern.marks["left_leg"], 0].min() > 0.003
    assert points[pattern.marks["right_leg"], 0].max() < -0.003


def test_legs_are_put_back_on_their_own_side():
    marks = {"left_leg": np.array([0, 1]), "right_leg": np.array([2])}
    points = np.array([[0.2, 1, 1], [-0.1, 1, 1], [0.0, 1, 1], [0.0, 1, 1]])
    out = separator(Pattern(marks=marks))(points)
    np.testing.assert_allclose(out[:, 0], [0.2, BETWEEN_LEGS_M, -BETWEEN_LEGS_M, 0])
    np.testing.assert_array_equal(out[:, 1:], 1)
    closer = separator(Pattern(marks=marks), 0.001)(np.zeros((4, 3)))
    np.testing.assert_allclose(closer[:, 0], [0.001, 0.001, -0.001, 0])


def test_fronts_give_way_by_half_of_what_is_lacking_each():
    right, left = [0, 1], [2, 3]
    points = np.zeros((4, 3))
    points[left, 0] = [-0.002, 0.02]
    out = separator(Pattern(marks={"placket": np.array([*right, *left])}))(points)
    assert np.isclose(out[2, 0] - out[0, 0], BETWEEN_FRONTS_M)
    assert np.isclose(out[2, 0] + out[0, 0], -0.002)
    np.testing.assert_array_equal(out[[1, 3], 0], [0, 0.02])


def test_garments_without_legs_and_fronts_stay():
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_array_equal(separator(Pattern())(points.copy()), points)
