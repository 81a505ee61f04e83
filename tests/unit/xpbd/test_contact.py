import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.contact import (
    Moves,
    held_slip,
    make_all_moves,
    make_moves,
    move,
    narrowed,
    touch_floor,
)


@wp.kernel
def _hold(slip: wp.vec3, up: wp.vec3, most: float, held: wp.array[wp.vec3]):
    held[wp.tid()] = held_slip(slip, up, most)


@pytest.mark.parametrize(
    ("most", "held"), [(9.0, [3, 4, 0]), (5.0, [3, 4, 0]), (1.0, [0.6, 0.8, 0]), (0.0, [0, 0, 0])]
)
def test_friction_holds_what_is_along_the_surface_up_to_its_limit(most, held):
    start_warp()
    found = wp.zeros(1, dtype=wp.vec3)
    up, slip = wp.vec3(0.0, 0.0, 1.0), wp.vec3(3.0, 4.0, 7.0)
    wp.launch(_hold, dim=1, inputs=[slip, up, most], outputs=[found])
    np.testing.assert_allclose(found.numpy()[0], held, atol=1e-6)


@wp.kernel
def _narrow(gap: float, rooms: wp.array[wp.vec2], gaps: wp.array[float]):
    gaps[wp.tid()] = narrowed(gap, rooms[wp.tid()])


def test_sheets_are_closer_to_each_other_where_the_body_faces_itself():
    start_warp()
    rooms = wp.array(
        np.float32([[1e3, 1e3], [0.012, 0.03], [0.006, 0.003], [0.0, 0.01]]),
        dtype=wp.vec2,
    )  # fmt: skip
    gaps = wp.zeros(4, dtype=float)
    wp.launch(_narrow, dim=4, inputs=[0.005, rooms], outputs=[gaps])
    np.testing.assert_allclose(gaps.numpy(), [0.005, 0.004, 0.001, 0.0], atol=1e-7)


GAP_M = 0.004
RELEASE_M, STICK_M = 3e-4, 2e-5  # in a step


def touch(before, place, *, floor_m=(0.0, 0.0), carry=(0.0, 0.0, 0.0), friction=0.5):
    """Where one vertex was and is, after it has touched a floor in the second half of a frame."""
    start_warp()
    with wp.ScopedDevice("cpu"):
        heights, clock = wp.array([floor_m], dtype=wp.vec2), wp.array([0.5, 1.0], dtype=float)
        state = [wp.array([point], dtype=wp.vec3) for point in (before, place)]
        carried, grip = wp.array([carry], dtype=wp.vec3), wp.array([friction], dtype=float)
        inputs = [heights, clock, carried, GAP_M, RELEASE_M, STICK_M, grip]
        wp.launch(touch_floor, dim=1, inputs=inputs, outputs=state)
        return [points.numpy()[0] for points in state]


def test_what_is_above_the_floor_is_left_alone():
    before, place = touch((1, 2, 0.0045), (1, 2, 0.0041))
    np.testing.assert_allclose([before, place], [(1, 2, 0.0045), (1, 2, 0.0041)], atol=1e-7)


def test_what_falls_through_is_put_on_the_floor_and_stops():
    before, place = touch((1, 2, GAP_M), (1, 2, 0.001))
    np.testing.assert_allclose([before, place], [(1, 2, GAP_M)] * 2, atol=1e-7)


def test_what_was_below_comes_out_slowly_and_gains_no_speed():
    before, place = touch((1, 2, -0.05), (1, 2, -0.051))
    assert place[2] == pytest.approx(-0.05 + RELEASE_M, abs=1e-7)
    assert place[2] - before[2] == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize(
    ("way_m", "left_m"), [(0.0003, 0), (0.003, 0.003 - 0.5 * (0.001 + STICK_M))]
)
def test_friction_holds_what_slides_less_than_it_is_pressed(way_m, left_m):
    before, place = touch((0, 0, GAP_M), (way_m, 0, GAP_M - 0.001))
    assert place[0] - before[0] == pytest.approx(left_m, abs=1e-7)


def test_the_floor_is_where_it_is_at_the_end_of_the_step():
    before, place = touch((0, 0, 0.05 + GAP_M), (0, 0, 0.05), floor_m=(0.0, 0.1))
    assert place[2] == pytest.approx(0.1 + GAP_M, abs=1e-6)
    assert place[2] - before[2] == pytest.approx(0.05, abs=1e-6)


def test_cloth_that_is_carried_down_onto_the_floor_stops():
    before, place = touch((0, 0, GAP_M - 0.01), (0, 0, GAP_M - 0.012), carry=(0, 0, -0.01))
    assert place[2] == pytest.approx(GAP_M, abs=1e-7)
    assert place[2] - before[2] == pytest.approx(0.01, abs=1e-7)


def test_cloth_that_is_carried_along_slides_back():
    """What it goes with the body is no slip of its own, but the floor stays behind."""
    before, place = touch((0.01, 0, GAP_M), (0.01, 0, GAP_M - 0.1), carry=(0.01, 0, 0))
    assert place[0] - before[0] == pytest.approx(-0.01, abs=1e-6)


@wp.kernel
def _push(
    which: wp.array[int],
    weights: wp.array[float],
    ways: wp.array[wp.vec3],
    moves: Moves,
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    k = wp.tid()
    i = which[k]
    move(moves, place, before, i, weights[k], place[i], ways[k], 0.5 * ways[k])


def pushed(which, weights, ways, parallel, passes=1):
    """Ways (5, 3) of vertices by pushes, and of the places that they came from."""
    start_warp()
    arrays = [
        wp.array(np.int32(which), dtype=int),
        wp.array(np.float32(weights), dtype=float),
        wp.array(np.float32(ways), dtype=wp.vec3),
    ]
    moves, before, place = (
        make_moves(5 * parallel),
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
    place, before = pushed(*pushes, parallel=False)
    np.testing.assert_allclose(place, sums(*pushes)[0], atol=1e-7)
    np.testing.assert_allclose(before, sums(*pushes)[0] / 2, atol=1e-7)


def test_at_once_the_sum_is_divided_by_the_root_of_the_shares(pushes):
    place, before = pushed(*pushes, parallel=True)
    found, weight = sums(*pushes)
    assert weight[:4].min() > 2
    np.testing.assert_allclose(place, found / np.sqrt(np.maximum(weight, 1)), atol=1e-6)
    np.testing.assert_allclose(before, place / 2, atol=1e-8)
    assert (place[4] == 0).all()


def test_pushes_of_small_shares_are_made_in_full():
    place, _ = pushed([2, 2], [0.3, 0.6], [[0.001, 0, 0], [0, 0.002, 0]], parallel=True)
    np.testing.assert_allclose(place[2], [0.001, 0.002, 0], atol=1e-9)


def test_the_order_makes_no_difference_to_the_bit(pushes):
    place, before = pushed(*pushes, parallel=True)
    order = rng_for(4, "order").permutation(40)
    again, then = pushed(*(part[order] for part in pushes), parallel=True)
    np.testing.assert_array_equal(again, place)
    np.testing.assert_array_equal(then, before)


def test_moves_that_were_made_are_forgotten(pushes):
    once, twice = (pushed(*pushes, parallel=True, passes=n)[0] for n in (1, 2))
    np.testing.assert_array_equal(twice, once)
