"""Nearest points against a sort of all distances, which are exact on a lattice and tie often."""

import numpy as np
import pytest

from drapeline.geometry.nearest_points import nearest_points


def lattice(count, seed, step=16):
    return np.random.default_rng(seed).integers(-step, step + 1, (count, 3)) / step


def by_sorting(points, places, count):
    squared = ((places[:, None] - points) ** 2).sum(axis=-1)
    order = np.argsort(squared, axis=1, kind="stable")[:, :count]
    return np.take_along_axis(squared, order, axis=1), order


@pytest.mark.parametrize("count", [1, 2, 7, 150, 400])
@pytest.mark.parametrize("spread", [0.1, 1, 30])
def test_the_nearest_are_those_of_a_sort(count, spread):
    points, places = lattice(400, 0), lattice(50, 1) * spread
    points[:250] /= 8  # crowded in the middle
    squared, index = nearest_points(points, places, count)
    expected, order = by_sorting(points, places, count)
    np.testing.assert_array_equal(np.sort(index, axis=1), np.sort(order, axis=1))
    np.testing.assert_array_equal(np.sort(squared, axis=1), expected)
    exact = ((places[:, None] - points[index]) ** 2).sum(axis=-1)
    np.testing.assert_array_equal(squared, exact)


def test_flat_and_coinciding_points_and_no_places():
    flat = lattice(60, 2) * [1, 0, 0]
    for points in (flat, np.ones((9, 3)), flat[:1]):
        _, index = nearest_points(points, flat[:5], len(points))
        assert (np.sort(index, axis=1) == np.arange(len(points))).all()
    squared, index = nearest_points(flat, np.zeros((0, 3)), 4)
    assert squared.shape == index.shape == (0, 4)
