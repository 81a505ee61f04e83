"""Turn-down collars."""

import numpy as np
import pytest

from drapeline.geometry.crossings import Crossings
from drapeline.outfits.patterns.cutting import cut_garment, size_of

EDGES_M = [0.035, 0.02, 0.01]
SHIRT = {
    "front": "buttoned",
    "placket_m": 0.08,
    "open_below": 0.3,
    "collar_stand_m": 0.03,
    "collar_fall_m": 0.05,
    "collar_point_m": 0.015,
}


def shirt(templates, numbers, edge_m, **changes):
    return cut_garment(templates.form, edge_m, upper=numbers | SHIRT | changes)


@pytest.fixture(params=EDGES_M)
def made(request, templates, upper_numbers):
    return shirt(templates, upper_numbers, request.param), request.param


def test_a_collar_stands_and_is_turned_down_outside_of_its_stand(made, templates):
    pattern, edge_m = made
    rows = pattern.vertices[pattern.marks["collar"]]
    size = size_of(templates.form)
    high = max(1, round(0.03 * size / edge_m))
    assert len(rows) == 1 + high + max(1, round(0.05 * size / edge_m))
    height = rows[..., 2] - rows[0, :, 2]
    assert 0.02 < height[high].mean() < 0.04
    assert (height[-1] < height[high]).all()
    back = rows.shape[1] // 2
    assert (rows[high + 1 :, back, 1] > rows[1 : high + 1, back, 1].max()).all()


def test_a_collar_neither_crosses_itself_nor_what_it_lies_on(made):
    pattern, _ = made
    crossings = Crossings([pattern.vertices.astype(np.float32)], [pattern.faces()])
    own, _ = crossings.find([pattern.vertices.astype(np.float32)])
    assert own.sum() == 0


def test_a_collar_has_two_equal_halves(made):
    pattern, edge_m = made
    rows = pattern.vertices[pattern.marks["collar"]]
    np.testing.assert_allclose(rows, rows[:, ::-1] * [-1, 1, 1], atol=0.2 * edge_m)


def test_points_in_front_are_longer_than_the_back(templates, upper_numbers):
    lengths = []
    for point in (0.0, 0.025):
        pattern = shirt(templates, upper_numbers, 0.01, collar_point_m=point)
        rows = pattern.vertices[pattern.marks["collar"]]
        steps = np.linalg.norm(np.diff(rows[3:], axis=0), axis=-1).sum(axis=0)
        lengths.append(steps[[0, len(steps) // 2]])
    (front, back), (longer, same) = lengths
    assert longer > front + 0.012
    assert same == pytest.approx(back, abs=0.002)
