import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.motion import add_speed, hold, predict, take_speed


def vectors(*rows):
    return wp.array(np.float32(rows), dtype=wp.vec3, device="cpu")


def numbers(*values):
    return wp.array(np.float32(values), dtype=float, device="cpu")


@pytest.fixture(autouse=True)
def _warp():
    start_warp()


def launch(kernel, count, *arrays):
    wp.launch(kernel, dim=count, inputs=list(arrays), device="cpu")


def test_a_particle_goes_by_its_speed_and_gravity_and_is_carried_without_gaining_speed():
    place, before, way = vectors([1, 2, 3]), vectors([0, 0, 0]), vectors([0, 0, 0])
    speed = vectors([1, 0, 0])
    launch(predict, 1, numbers(0.5), vectors([0, 0.2, 0]), 0.1, speed, way, before, place)
    np.testing.assert_allclose(before.numpy(), [[1, 2.2, 3]])
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
    for _ in range(steps):
        launch(predict, 1, numbers(1), vectors([0, 0, 0]), step_s, speed, way, before, place)
        launch(take_speed, 1, way, before, place, step_s, speed)
    np.testing.assert_allclose(speed.numpy()[0], [0, 0, -9.81 * step_s * steps], rtol=1e-4)


def test_a_held_vertex_is_pulled_a_share_of_the_way_to_where_it_is_held_now():
    place = vectors([0, 0, 0], [9, 9, 9])
    held = wp.array([1], dtype=int, device="cpu")
    start, end = vectors([0, 0, 0]), vectors([4, 0, 0])
    launch(hold, 1, held, numbers(0.5), start, end, numbers(0.25, 0.5), place)
    np.testing.assert_allclose(place.numpy(), [[0, 0, 0], [5.5, 4.5, 4.5]])
