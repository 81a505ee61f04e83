"""Separation of what lies side by side in a garment: trouser legs, the edges of an open front."""

import numpy as np

from drapeline.geometry.smoothing import Constraint
from drapeline.outfits.patterns.panels import Pattern

BETWEEN_LEGS_M = 0.004  # half the distance between the two legs
BETWEEN_FRONTS_M = 0.004
_SIDES = (("left", 1.0), ("right", -1.0))


def separator(pattern: Pattern, between_legs_m: float = BETWEEN_LEGS_M) -> Constraint:
    """A function that puts vertices (V, 3) of a garment back on their own sides, in place.

    Args:
        pattern: of the garment, with its marks.
        between_legs_m: half the distance that is kept between two trouser legs.
    """
    marks = pattern.marks
    legs = [(marks[f"{s}_leg"], sign) for s, sign in _SIDES if f"{s}_leg" in marks]
    right, left = np.split(marks.get("placket", np.zeros(0, dtype=int)), 2)

    def separate(points: np.ndarray) -> np.ndarray:
        for leg, sign in legs:
            points[leg, 0] = sign * np.maximum(sign * points[leg, 0], between_legs_m)
        lack = np.maximum(BETWEEN_FRONTS_M - (points[left, 0] - points[right, 0]), 0) / 2
        points[left, 0] += lack
        points[right, 0] -= lack
        return points

    return separate
