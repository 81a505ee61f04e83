"""Curves and outlines of round tubes."""

import numpy as np
import pytest

from drapeline.outfits.dress_form import ANGLES, STEP_M, Tube
from drapeline.outfits.patterns.curves import hang, limb_loop, ring, space_evenly, straighten


def round_tube(radii):
    radii = np.asarray(radii, dtype=float)
    return Tube(0.0, np.zeros((len(radii), 2)), np.repeat(radii[:, None], ANGLES, axis=1))


def test_a_ring_of_a_round_tube_is_a_regular_polygon():
    points = ring(round_tube([0.1] * 5), 0.02, 0.01, 24)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 0.11, rtol=2e-3)
    steps = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-2)
    # Right side first, then the front (-Y): counter-clockwise from above.
    assert points[0, 0] == pytest.approx(-0.11)
    assert points[6, 1] == pytest.approx(-0.11, rel=1e-2)


def test_a_limb_loop_turns_as_told():
    loops = [limb_loop(round_tube([0.1] * 3), 0.01, 0.0, np.pi, 16, turn) for turn in (1, -1)]
    np.testing.assert_allclose(loops[0][1:], loops[1][1:][::-1], atol=1e-9)
    x, y = np.moveaxis(loops, 2, 0)
    area = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    assert area[0] == pytest.approx(-area[1])


def test_hung_cloth_bridges_hollows_with_the_given_slope():
    # A wide chest over a narrow waist; rows go up.
    tube = hang(round_tube([0.1] * 20 + [0.2] * 5), down=0.2, up=0.5, top_m=0.24)
    below = tube.radius[:20, 0]
    np.testing.assert_allclose(np.diff(below), 0.2 * STEP_M)
    assert below[-1] == pytest.approx(0.2 - 0.2 * STEP_M)


def test_straightened_limbs_have_no_bulges():
    bulge = 0.05 + 0.03 * np.exp(-(((np.arange(60) - 30) / 4) ** 2))
    radius = straighten(round_tube(bulge), 0.1).radius[:, 0]
    assert (radius >= bulge - 1e-12).all()
    assert np.abs(np.diff(radius)).max() <= bulge.max()
    falling = np.diff(radius[:30])
    assert falling.max() <= 0.1 * STEP_M + 1e-12


def test_spaced_points_are_equally_far_along_the_curve():
    corner = np.array([[0.0, 0, 0], [3, 0, 0], [3, 1, 0]])
    np.testing.assert_allclose(
        space_evenly(corner, 4), [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0]]
    )
