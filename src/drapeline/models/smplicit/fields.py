"""What a distance field around a body is to those who look for the surface in it."""

from typing import Protocol

import numpy as np


class Field(Protocol):
    """Distances from points in space to a garment's surface, exact or learned.

    A learned field is clipped at the distance it was trained up to, may be slightly negative close
    to the surface, and grows only roughly as fast as one moves away.

    Attributes:
        clip_m: the greatest distance that it tells.
    """

    clip_m: float

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (P,) float32 in metres at points (P, 3) in metres."""
        ...

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (P,) in metres at points (P, 3), and their gradients (P, 3)."""
        ...
