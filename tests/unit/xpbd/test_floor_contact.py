import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.floor_contact import touch_floor

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
