"""What a user may choose about a simulation."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class SimulationSettings:
    """How cloth is simulated.

    Attributes:
        steps_min, steps_max: solver steps per frame for the simplest and most complex outfit.
        shape_frames: frames in which the body goes from the garments' shape to its own.
        pose_frames: frames from the rest pose to the first pose.
        gap_m: distance between cloth and body in metres.
        collider_share: of the body's triangles that the first try collides with; later ones
            take all.
        attempts: tries, each finer than the last, before a sample is rejected.
    """

    steps_min: int = 14
    steps_max: int = 20
    shape_frames: int = 10
    pose_frames: int = 20
    gap_m: float = 0.004
    collider_share: float = 1.0
    attempts: int = 3


_SIMPLE_VERTICES, _COMPLEX_VERTICES = 4_000, 16_000
_CALM_M_S, _FAST_M_S = 1.0, 4.0


def steps_per_frame(
    settings: SimulationSettings, vertex_counts: Sequence[int], speed_m_s: float
) -> int:
    """Solver steps between `steps_min` and `steps_max` by size and speed (CLOTH3D: 14 to 20).

    Args:
        vertex_counts: of every garment; a second layer makes an outfit more complex.
        speed_m_s: 95th percentile of the speed of the body's vertices, relative to its root.
    """
    size = (sum(vertex_counts) - _SIMPLE_VERTICES) / (_COMPLEX_VERTICES - _SIMPLE_VERTICES)
    speed = (speed_m_s - _CALM_M_S) / (_FAST_M_S - _CALM_M_S)
    complexity = (min(max(size, 0.0), 1.0) + min(max(speed, 0.0), 1.0)) / 2
    return round(settings.steps_min + complexity * (settings.steps_max - settings.steps_min))
