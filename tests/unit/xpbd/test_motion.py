import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.motion import add_speed, hold, predict, take_places, take_speed, tick


def vectors(*rows):
    return wp.array(np.float32(rows), dtype=wp.vec3)


def weigh(*rows):
    """Places and inverse masses."""
    return wp.array(np.float32(rows), dtype=wp.vec4)


def numbers(*values):
    return wp.array(np.float32(values), dtype=float)


@pytest.fixture(autouse=True)
def _warp():
    start_warp()


def launch(kernel, count, *arrays):
    wp.launch(kernel, dim=count, inputs=list(arrays))


def test_a_particle_goes_by_its_speed_and_gravity_and_is_carried_without_gaining_speed():
    place, before, way = vectors([1, 2, 3]), vectors([0, 0, 0]), vectors([0, 0, 0])
    speed, weighed = vectors([1, 0, 0]), weigh([0, 0, 0, 7])
    launch(predict, 1, numbers(0.5), vectors([0, 0.2, 0]), 0.1, speed, way, before, place, weighed)
    np.testing.assert_allclose(before.numpy(), [[1, 2.2, 3]])
    launch(take_places, 1, weighed, place)
    assert weighed.numpy()[0, 3] == 7
    np.testing.assert_allclose(place.numpy(), [[1.05, 2.2, 3 - 0.5 * 0.0981]], rtol=1e-6)
    launch(take_speed, 1, way, before, place, 0.1, speed)
    np.testing.assert_allclose(speed.numpy(), [[0.5, 0, -0.5 * 0.981]], atol=1e-5)
    pushed = vectors(place.numpy()[0] + [0, 0, 0.02])
    launch(take_speed, 1, way, before, pushed, 0.1, speed)
    np.testing.assert_allclose(speed.numpy(), [[0.5, 0, 0.2 - 0.5 * 0.981]], atol=1e-5)
    launch(add_speed, 1, wp.vec3(0.0, 1.0, 0.0), speed)
    np.testing.assert_allclose(speed.numpy()[0, 1], 1, atol=1e-5)


def test_gravity_is_exact_however_short_the_steps_and_far_the_place():
    """A step of the way of a fall may be less than half of the last place of the position."""
    step_s, steps = 1e-4, 200
    place, before, way, speed = (vectors([v, 0, v]) for v in (50, 0, 0, 0))
    weighed = weigh([0, 0, 0, 1])
    for _ in range(steps):
        state = speed, way, before, place, weighed
        launch(predict, 1, numbers(1), vectors([0, 0, 0]), step_s, *state)
        launch(take_places, 1, weighed, place)
        launch(take_speed, 1, way, before, place, step_s, speed)
    np.testing.assert_allclose(speed.numpy()[0], [0, 0, -9.81 * step_s * steps], rtol=1e-4)


def test_a_held_vertex_is_pulled_a_share_of_the_way_to_where_it_is_held_now():
    weighed = weigh([0, 0, 0, 5], [9, 9, 9, 6])
    held = wp.array([1], dtype=int)
    start, end = vectors([0, 0, 0]), vectors([4, 0, 0])
    launch(hold, 1, held, numbers(0.5), start, end, numbers(0.25, 0.5), weighed)
    np.testing.assert_allclose(weighed.numpy(), [[0, 0, 0, 5], [5.5, 4.5, 4.5, 6]])


def test_the_clock_goes_from_0_to_1_and_begins_again():
    ticks, clock = wp.zeros(1, dtype=int), numbers(0, 0)
    shown = []
    for _ in range(5):
        launch(tick, 1, 4, ticks, clock)
        shown.append(clock.numpy().tolist())
    assert shown == [[0, 0.25], [0.25, 0.5], [0.5, 0.75], [0.75, 1], [0, 0.25]]
