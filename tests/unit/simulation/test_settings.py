import pytest

from drapeline.simulation.settings import SimulationSettings, steps_per_frame


def test_simple_and_complex_outfits_take_the_two_ends():
    settings = SimulationSettings(steps_min=14, steps_max=20)
    assert steps_per_frame(settings, [3000], 0.2) == 14
    assert steps_per_frame(settings, [9000, 9000], 8.0) == 20


@pytest.mark.parametrize(("slow", "fast"), [(0.5, 2.0), (2.0, 3.5)])
def test_speed_and_size_never_take_steps_away(slow, fast):
    settings = SimulationSettings()
    assert steps_per_frame(settings, [5000], slow) <= steps_per_frame(settings, [5000], fast)
    assert steps_per_frame(settings, [5000], slow) <= steps_per_frame(settings, [5000, 5000], slow)
