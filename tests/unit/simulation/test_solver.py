import numpy as np
import pytest

from drapeline.frames import REST_POSE
from drapeline.simulation.settings import SimulationSettings
from drapeline.simulation.solver import plan_attempt, steps_per_frame


def test_simple_and_complex_outfits_take_the_two_ends():
    settings = SimulationSettings(steps_min=14, steps_max=20)
    assert steps_per_frame(settings, [3000], 0.2) == 14
    assert steps_per_frame(settings, [9000, 9000], 8.0) == 20


@pytest.mark.parametrize(("slow", "fast"), [(0.5, 2.0), (2.0, 3.5)])
def test_speed_and_size_never_take_steps_away(slow, fast):
    settings = SimulationSettings(steps_min=14, steps_max=20)
    assert steps_per_frame(settings, [5000], slow) <= steps_per_frame(settings, [5000], fast)
    assert steps_per_frame(settings, [5000], slow) <= steps_per_frame(settings, [5000, 5000], slow)


def test_the_first_attempt_is_as_asked_and_later_ones_are_finer():
    settings = SimulationSettings(
        collider_share=0.6, pose_frames=8, shape_frames=4, settle_frames=6
    )
    still = np.tile(REST_POSE, (5, 1))
    first, second, third = (plan_attempt(k, settings, [3000], still) for k in range(3))
    assert (first.steps, second.steps, third.steps) == (14, 21, 28)
    assert (first.collider_share, second.collider_share, third.collider_share) == (0.6, 1, 1)
    assert [a.pose_frames for a in (first, second, third)] == [8, 16, 24]
    assert [a.lead_frames for a in (first, second)] == [4 + 1 + 8 + 6, 4 + 1 + 16 + 6]
    assert {a.gap_m for a in (first, second, third)} == {settings.gap_m}


def test_a_fast_dance_takes_more_steps_than_standing_still():
    still = np.tile(REST_POSE, (5, 1))
    dance = still + 0.3 * np.arange(5)[:, None]  # 4.5 m/s half a metre from each joint's axis
    settings = SimulationSettings(steps_min=14, steps_max=20)
    calm, fast = (plan_attempt(0, settings, [3000], poses) for poses in (still, dance))
    assert (calm.steps, fast.steps) == (14, 17)


def test_a_single_frame_is_calm():
    assert plan_attempt(0, SimulationSettings(), [3000], REST_POSE[None]).steps == 14
