"""Bounds of a simulation's health that nothing exceeds."""

from drapeline.simulation.settings import HealthBounds

NO_BOUNDS = HealthBounds(
    inside_open_mean=1,
    inside_open_max=1,
    depth_m=1,
    stretch_low=0,
    stretch_high=10,
    slip_m=2,
    lost_openings=10,
    layer_share_mean=1,
    self_share_mean=1,
)
