"""What bears weight: measures against known motions."""

import numpy as np
import pytest

from drapeline.bodies.contact import GRAVITY_M_S2, floor_contact
from drapeline.frames import FPS, JOINT_NAMES

LEFT, RIGHT = (JOINT_NAMES.index(f"{side}_foot") for side in ("left", "right"))


def contact(points, segments):
    """Of single points (N, V, 3) in the world, each of which belongs to a segment (V,)."""
    return floor_contact(np.asarray(points), np.zeros((len(points), 3)), np.array(segments))


def test_a_slide_is_measured_where_weight_is_borne():
    """A foot on the floor moves 1 cm per frame; the other swings past, 1 cm above it."""
    points = np.zeros((6, 2, 3))
    points[:, 0, 0] = 0.01 * np.arange(6)
    points[:, 1] = np.stack([0.1 * np.arange(6), np.zeros(6), np.full(6, 0.01)], axis=1)
    points[2, 0, 2] = -0.002
    found = contact(points, [LEFT, RIGHT])
    assert found.sliding_m_s == pytest.approx(0.3)
    assert found.penetration_m == pytest.approx(0.002)
    assert found.hover_s == 0


def test_a_foot_that_turns_on_the_spot_does_not_slide():
    angle = np.linspace(0, 1, 8)
    toe = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=1)
    points = 0.1 * np.stack([toe, -toe], axis=1)
    assert contact(points, [LEFT, LEFT]).sliding_m_s == pytest.approx(0, abs=1e-12)
    assert contact(points[:, :1], [LEFT]).sliding_m_s > 0.3


@pytest.mark.parametrize("speed_m_s", [1.0, 2.0, 3.0])
def test_a_ball_thrown_up_hovers_as_long_as_its_flight(speed_m_s):
    times = np.arange(40) / FPS
    height = np.maximum(speed_m_s * times - GRAVITY_M_S2 / 2 * times**2, 0)
    points = np.zeros((40, 1, 3))
    points[:, 0, 2] = height
    found = contact(points, [LEFT])
    assert found.flight_s == pytest.approx(2 * speed_m_s / GRAVITY_M_S2, abs=0.01)
    assert found.hover_s == pytest.approx(found.flight_s, abs=0.05)


def test_the_hover_that_no_flight_explains_is_reported():
    """A high flight, and a second at 3 cm, which is shorter."""
    points = np.zeros((70, 1, 3))
    points[5:35, 0, 2] = 1.5
    points[40:65, 0, 2] = 0.03
    found = contact(points, [LEFT])
    assert found.hover_s == pytest.approx(25 / FPS)
    assert found.flight_s == pytest.approx(2 * np.sqrt(2 * 0.03 / GRAVITY_M_S2))
