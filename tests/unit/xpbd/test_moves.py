import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.moves import Moves, make_all_moves, make_moves, move


@wp.kernel
def _push(
    which: wp.array(dtype=int),
    weights: wp.array(dtype=float),
    ways: wp.array(dtype=wp.vec3),
    moves: Moves,
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    k = wp.tid()
    i = which[k]
    move(moves, place, before, i, weights[k], place[i], ways[k], 0.5 * ways[k])


def pushed(which, weights, ways, together, passes=1):
    """Ways (5, 3) of vertices by pushes, and of the places that they came from."""
    start_warp()
    arrays = [
        wp.array(np.int32(which), dtype=int),
        wp.array(np.float32(weights), dtype=float),
        wp.array(np.float32(ways), dtype=wp.vec3),
    ]
    moves, before, place = (
        make_moves(5 * together),
        *(wp.zeros(5, dtype=wp.vec3) for _ in range(2)),
    )
    wp.launch(_push, dim=len(which), inputs=[*arrays, moves, before, place])
    for _ in range(passes):
        inputs = [moves, before, place]
        wp.launch(make_all_moves, dim=len(moves.weight), inputs=inputs)
    return place.numpy(), before.numpy()


@pytest.fixture
def pushes():
    rng = rng_for(3, "pushes")
    return rng.integers(0, 4, 40), rng.uniform(0, 1, 40), rng.normal(0, 0.003, (40, 3))


def sums(which, weights, ways):
    found, total = np.zeros((5, 3)), np.zeros(5)
    np.add.at(found, which, ways)
    np.add.at(total, which, weights)
    return found, total[:, None]


@pytest.mark.processor_only
def test_in_turn_every_push_is_made(pushes):
    place, before = pushed(*pushes, together=False)
    np.testing.assert_allclose(place, sums(*pushes)[0], atol=1e-7)
    np.testing.assert_allclose(before, sums(*pushes)[0] / 2, atol=1e-7)


def test_at_once_the_sum_is_divided_by_the_root_of_the_shares(pushes):
    place, before = pushed(*pushes, together=True)
    found, weight = sums(*pushes)
    assert weight[:4].min() > 2
    np.testing.assert_allclose(place, found / np.sqrt(np.maximum(weight, 1)), atol=1e-6)
    np.testing.assert_allclose(before, place / 2, atol=1e-8)
    assert (place[4] == 0).all()


def test_pushes_of_small_shares_are_made_in_full():
    place, _ = pushed([2, 2], [0.3, 0.6], [[0.001, 0, 0], [0, 0.002, 0]], together=True)
    np.testing.assert_allclose(place[2], [0.001, 0.002, 0], atol=1e-9)


def test_the_order_makes_no_difference_to_the_bit(pushes):
    place, before = pushed(*pushes, together=True)
    order = rng_for(4, "order").permutation(40)
    again, then = pushed(*(part[order] for part in pushes), together=True)
    np.testing.assert_array_equal(again, place)
    np.testing.assert_array_equal(then, before)


def test_moves_that_were_made_are_forgotten(pushes):
    once, twice = (pushed(*pushes, together=True, passes=n)[0] for n in (1, 2))
    np.testing.assert_array_equal(twice, once)
