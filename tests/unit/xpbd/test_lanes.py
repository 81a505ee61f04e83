import numpy as np
import pytest

from drapeline.geometry.mesh import edges
from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.colouring import colour_constraints
from drapeline.xpbd.lanes import LANES, fill_lanes, lay_in_lanes
from sheet_toys import sheet


@pytest.mark.parametrize("sizes", [[0], [1], [8], [9], [3, 16, 7], [8, 8, 1]])
def test_each_constraint_has_one_lane_and_a_row_one_colour(sizes):
    colours = np.repeat(np.arange(len(sizes)), sizes)
    lanes = fill_lanes(colours)
    assert lanes.shape == (sum(-(-size // LANES) for size in sizes), LANES)
    assert lanes[lanes >= 0].tolist() == list(range(len(colours)))
    for row in lanes:
        assert len(np.unique(colours[row[row >= 0]])) == 1
        assert (np.diff(row < 0) >= 0).all()  # full lanes first


def test_full_lanes_of_a_row_share_no_vertex():
    start_warp()
    pairs = edges(sheet(0.0).faces)
    colours = colour_constraints(pairs, 169)
    order = np.argsort(colours, kind="stable")
    lanes = fill_lanes(colours[order])
    for row in lanes:
        ends = pairs[order][row[row >= 0]].ravel()
        assert len(np.unique(ends)) == len(ends)


def test_an_empty_lane_repeats_the_first_of_its_row():
    values = np.arange(22).reshape(11, 2)
    laid = lay_in_lanes(values, fill_lanes(np.repeat([0, 1], [9, 2])))
    assert laid.shape == (3, 2, LANES)
    assert laid[0].T.tolist() == values[:8].tolist()
    assert laid[1, 0].tolist() == [16] * LANES
    assert laid[2, 1].tolist() == [19, 21, *[19] * 6]
