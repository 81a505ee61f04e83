"""Equation 1 of CLOTH3D: the width of sleeves, legs and skirts along their axis."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class WidthLine:
    """W(x) = a1 x + a2 max(0, x - x_offset) + W0."""

    # alpha1, alpha2: metres of width per metre along the axis.
    alpha1: float
    alpha2: float
    x_offset_m: float  # from here on the second slope is added
    w0_m: float  # width at x = 0, the shoulder, hip or waist

    def __call__(self, x_m: float | np.ndarray) -> float | np.ndarray:
        """Width in metres at `x_m` metres along the axis."""
        return self.alpha1 * x_m + self.alpha2 * np.maximum(0, x_m - self.x_offset_m) + self.w0_m
