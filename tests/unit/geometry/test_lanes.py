import numpy as np
import pytest

from drapeline.geometry.lanes import (
    LANES,
    fill_lanes,
    lay_in_lanes,
    make_patches,
    rows_of_neighbours,
)
from drapeline.geometry.mesh import edges
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.system import colour_constraints
from toys.sheets import sheet


@pytest.mark.parametrize("width", [1, LANES])
@pytest.mark.parametrize("sizes", [[0], [1], [8], [9], [3, 16, 7], [8, 8, 1]])
def test_each_constraint_has_one_lane_and_a_row_one_colour(sizes, width):
    colours = np.repeat(np.arange(len(sizes)), sizes)
    lanes = fill_lanes(colours, width)
    assert lanes.shape == (sum(-(-size // width) for size in sizes), width)
    assert lanes[lanes >= 0].tolist() == list(range(len(colours)))
    for row in lanes:
        assert len(np.unique(colours[row[row >= 0]])) == 1
        assert (np.diff(row < 0) >= 0).all()  # full lanes first


def test_full_lanes_of_a_row_share_no_vertex():
    start_warp()
    pairs = edges(sheet(0.0).faces)
    colours = colour_constraints(pairs, 169)
    order = np.argsort(colours, kind="stable")
    lanes = fill_lanes(colours[order], LANES)
    for row in lanes:
        ends = pairs[order][row[row >= 0]].ravel()
        assert len(np.unique(ends)) == len(ends)


def test_an_empty_lane_repeats_the_first_of_its_row():
    values = np.arange(22).reshape(11, 2)
    laid = lay_in_lanes(values, fill_lanes(np.repeat([0, 1], [9, 2]), LANES))
    assert laid.shape == (3, 2, LANES)
    assert laid[0].T.tolist() == values[:8].tolist()
    assert laid[1, 0].tolist() == [16] * LANES
    assert laid[2, 1].tolist() == [19, 21, *[19] * 6]


@pytest.mark.parametrize("sizes", [[1], [8], [100, 3], [57, 64, 9]])
def test_patches_have_each_point_once_and_one_group(sizes):
    points = rng_for(1, "points").uniform(size=(sum(sizes), 3))
    groups = np.repeat(np.arange(len(sizes)), sizes)
    patches = make_patches(points, groups)
    assert len(patches) == sum(-(-size // LANES) for size in sizes)
    assert sorted(patches[patches >= 0]) == list(range(len(points)))
    for row in patches:
        assert len(np.unique(groups[row[row >= 0]])) == 1


def test_points_of_a_patch_lie_together():
    x, y = np.meshgrid(np.arange(16.0), np.arange(8.0))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    for row in make_patches(points, np.zeros(128, dtype=int)):
        assert sorted(np.ptp(points[row], axis=0)) == [0, 1, 3]


@pytest.mark.parametrize("count", [1, 7, 8, 9, 100])
def test_rows_of_neighbours_have_each_point_once_and_repeat_the_last(count):
    rows = rows_of_neighbours(rng_for(2, "points").uniform(-3, 2, (count, 3)))
    numbers = rows.ravel()
    assert rows.shape == (-(-count // LANES), LANES)
    assert sorted(numbers[:count]) == list(range(count))
    assert set(numbers[count:]) <= {numbers[count - 1]}


def test_a_row_of_neighbours_is_a_cell_of_the_cube():
    cells = np.stack(np.meshgrid(*3 * [np.arange(4.0)], indexing="ij"), axis=-1).reshape(-1, 3)
    cells = rng_for(3, "cells").permutation(cells)
    for row in rows_of_neighbours(cells):
        assert np.ptp(cells[row], axis=0).tolist() == [1, 1, 1]
        assert (cells[row].min(axis=0) % 2 == 0).all()


def test_points_in_one_place_are_rows_too():
    rows = rows_of_neighbours(np.full((11, 3), 5.0))
    assert sorted(set(rows.ravel())) == list(range(11))
