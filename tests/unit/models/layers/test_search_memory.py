"""Searches answered from memory are those that would be made."""

import pytest
import torch

from drapeline.models.layers.point_search import (
    SEARCH_ANEW,
    BallSearch,
    SearchMemory,
    farthest_points,
    gather_rows,
    nearest_neighbours,
)


@pytest.fixture
def clouds():
    """Three windows of two clouds each, some points of which are not valid."""
    draw = torch.Generator().manual_seed(0)
    return torch.rand(6, 80, 3, generator=draw), torch.rand(6, 80, generator=draw) < 0.7


def search_all(searches, points, valid):
    chosen = searches("farthest", farthest_points, points, 12, valid)
    centres = gather_rows(points, chosen)
    ball = searches.within("ball")("points", BallSearch(points, 0.5, valid), centres, 4)
    nearest = searches.within("nearest")("points", nearest_neighbours, points, centres, 3, valid)
    return [chosen, ball, *nearest]


def forbidden(*_):
    raise AssertionError("searched again")


def recall_all(searches):
    """The same searches, which must not be made."""
    ball = searches.within("ball")("points", forbidden)
    nearest = searches.within("nearest")("points", forbidden)
    return [searches("farthest", forbidden), ball, *nearest]


def test_searches_made_before_are_recalled_window_by_window(clouds):
    points, valid = clouds
    expected = search_all(SEARCH_ANEW, points, valid)
    memory = SearchMemory(1 << 20)
    for window, part in (("a", slice(0, 2)), ("b", slice(2, 4))):
        search_all(memory.of([window]), points[part], valid[part])
    found = search_all(memory.of("bc"), points[2:], valid[2:])  # c is new
    for x, y in zip(found, expected, strict=True):
        assert torch.equal(x, y[2:])
    found = recall_all(memory.of("cab"))
    for x, y in zip(found, expected, strict=True):
        assert torch.equal(x, y[[4, 5, 0, 1, 2, 3]])
        assert x.dtype == y.dtype


def test_a_window_is_searched_anew_if_one_of_its_batch_is_unknown(clouds):
    points, valid = clouds
    memory = SearchMemory(1 << 20)
    search_all(memory.of("a"), points[:2], valid[:2])
    with pytest.raises(AssertionError, match="searched again"):
        recall_all(memory.of("ad"))


def test_answers_do_not_depend_on_the_order_of_the_searches(clouds):
    points, valid = clouds
    memory = SearchMemory(1 << 20)
    search_all(memory.of("abc"), points, valid)
    searches = memory.of("abc")
    nearest = searches.within("nearest")("points", forbidden)
    chosen = searches("farthest", forbidden)
    expected = search_all(SEARCH_ANEW, points, valid)
    assert torch.equal(chosen, expected[0])
    assert torch.equal(nearest[1], expected[3])


def test_answers_there_is_no_room_for_are_searched_again(clouds):
    points, valid = clouds
    memory = SearchMemory(100)
    for cloud in (points, -points):
        found = search_all(memory.of("abc"), cloud, valid)
        for x, y in zip(found, search_all(SEARCH_ANEW, cloud, valid), strict=True):
            assert torch.equal(x, y)


def test_two_searches_of_one_name_are_refused(clouds):
    points, valid = clouds
    searches = SearchMemory(1 << 20).of("abc").within("ball")
    searches("points", farthest_points, points, 3, valid)
    with pytest.raises(ValueError, match="two searches of a forward pass are named 'ball/points'"):
        searches("points", farthest_points, points, 4, valid)
