import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.launches import BusyLaunch, Replay, record


@wp.kernel
def _add_count(
    busy: wp.array(dtype=int),
    count: wp.array(dtype=int),
    factor: int,
    total: wp.array(dtype=int),
    seen: wp.array(dtype=int),
):
    i = busy[wp.tid()]
    total[i] = total[i] + factor * count[i]
    seen[wp.tid()] = i


@pytest.mark.processor_only
def test_those_with_a_count_are_launched_in_order_once_they_are_found():
    start_warp()
    count = wp.array(np.int32([0, 2, 0, 1, 3]), dtype=int)
    total = wp.zeros(5, dtype=int)
    seen = wp.full(5, -1, dtype=int)
    launch = BusyLaunch(_add_count, count, [10], [total, seen])
    launch.launch()
    assert total.numpy().tolist() == [0] * 5
    launch.find()
    for _ in range(2):
        launch.launch()
    assert total.numpy().tolist() == [0, 40, 0, 20, 60]
    assert seen.numpy().tolist() == [1, 3, 4, -1, -1]
    count.assign(np.int32([1, 0, 0, 0, 0]))
    launch.find()
    launch.launch()
    assert total.numpy().tolist() == [10, 40, 0, 20, 60]
    count.zero_()
    launch.find()
    launch.launch()
    assert total.numpy().tolist() == [10, 40, 0, 20, 60]


def test_nothing_is_launched_for_nothing():
    start_warp()
    empty = wp.zeros(0, dtype=int)
    assert record(_add_count, 0, [empty, empty, 1], [empty, empty]) is None
    launch = BusyLaunch(_add_count, empty, [1], [empty, empty])
    launch.find()
    launch.launch()


def test_launches_are_recorded_once_and_made_in_order_each_time():
    start_warp()
    one, two = (wp.array(np.int32([n]), dtype=int) for n in (1, 2))
    busy, seen = wp.zeros(1, dtype=int), wp.zeros(1, dtype=int)
    calls = []

    def times(factor, source, total):
        calls.append(factor)
        wp.launch(_add_count, 1, [busy, source, factor, total, seen])

    replay = Replay([lambda: times(10, one, two), lambda: times(100, two, one)])
    assert not calls
    for expected in ((1 + 100 * 12, 2 + 10), (1 + 1200 + 100 * 12022, 12 + 10 * 1201)):
        replay()
        assert (one.numpy()[0], two.numpy()[0]) == expected
    assert calls == [10, 100]
