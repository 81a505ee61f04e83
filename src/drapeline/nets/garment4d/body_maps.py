"""Maps of the body in the rest pose, and a garment's shape read from them in closed form.

A map shows where sleeves and hems end, and how far cloth stands off. From a hundred garments a
linear regression on it estimates shapes that networks trained by steps do not come near to; neither
is part of Garment4D.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from drapeline.errors import InputError
from drapeline.nets.precision import full_precision

# Seen from the front, left and right halves as one.
_REACH_M, _BOTTOM_M, _TOP_M = 0.95, -1.1, 0.5
_LEAST_DEVIATION = 1e-3  # a cell that hardly any garment reaches says nothing
_RIDGES = np.logspace(-3, 1, 9)


def map_cells(cell_m: float) -> int:
    """Cells of a map, `cell_m` wide and high."""
    columns, rows = _counts(cell_m)
    return columns * rows


def body_map(
    features: torch.Tensor, values: torch.Tensor, frames: int, cell_m: float
) -> torch.Tensor:
    """Means of values over the cells of a map.

    Args:
        features: (B * T, P, 4) of located points, see `Wearer.located`.
        values: (B * T, P, C) of the same points.
        frames: T.
        cell_m: width and height of a cell.

    Returns:
        (B, C * cells) over all frames of a window, 0 in a cell without points.
    """
    columns, rows = _counts(cell_m)
    column = (features[..., 0].abs() / cell_m).long().clamp(0, columns - 1)
    row = ((features[..., 2] - _BOTTOM_M) / cell_m).long().clamp(0, rows - 1)
    cell = (column * rows + row).unflatten(0, (-1, frames)).flatten(1)
    value = values.unflatten(0, (-1, frames)).flatten(1, 2).mT  # (B, C, T * P)
    empty = value.new_zeros(*value.shape[:2], columns * rows)
    count = empty[:, 0].scatter_add(1, cell, torch.ones_like(value[:, 0]))
    total = empty.scatter_add(2, cell[:, None].expand_as(value), value)
    return (total / count.clamp_min(1)[:, None]).flatten(1)


def _counts(cell_m: float) -> tuple[int, int]:
    return round(_REACH_M / cell_m), round((_TOP_M - _BOTTOM_M) / cell_m)


class MapRegression(nn.Module):
    """Ridge regression from maps to coefficients; says 0 until it is fitted.

    Args:
        inputs: values of a map.
        components: D, coefficients.
    """

    def __init__(self, inputs: int, components: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("weight", torch.zeros(inputs, components))
        self.register_buffer("bias", torch.zeros(components))

    @full_precision
    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """Maps (B, inputs) -> coefficients (B, D)."""
        return (maps - self.mean) @ self.weight + self.bias

    def fit(
        self,
        maps: np.ndarray,
        coefficients: np.ndarray,
        sequence: Sequence[int],
        metric: np.ndarray,
    ) -> tuple[np.ndarray, float]:
        """Fit to windows; every sequence counts the same, however many windows it has.

        The ridge is the one whose predictions for sequences left out of the fit are best. Those
        have a closed form: if H is the matrix that gives predictions from truths, and H_ss its part
        within a sequence, what is left out there errs by (I - H_ss)^-1 times the error of the fit.

        Args:
            maps: (W, inputs).
            coefficients: (W, D) true ones.
            sequence: (W,) that each window is of, two different ones or more.
            metric: (D, D), so that e @ metric @ e is the squared error of coefficients off by e.

        Returns:
            (W, D) float32 predictions for each sequence as if it had been left out, and the root of
            the mean of their squared errors.

        Raises:
            InputError: all windows are of one sequence.
        """
        _, owner, count = np.unique(sequence, return_inverse=True, return_counts=True)
        if len(count) < 2:
            raise InputError("1 training sequence, expected two or more to fit maps of the body to")
        share = 1 / count[owner]
        mean, middle = (
            np.average(x.astype(np.float64), axis=0, weights=share) for x in (maps, coefficients)
        )
        gap = maps - mean
        deviation = np.sqrt(np.average(gap**2, axis=0, weights=share))
        scale = np.divide(1, deviation, where=deviation > _LEAST_DEVIATION, out=0 * deviation)
        scale /= np.sqrt(max((scale > 0).sum(), 1))
        root = np.sqrt(share)[:, None]
        left, singular, right = np.linalg.svd(root * gap * scale, full_matrices=False)
        truth = root * (coefficients - middle)
        inner = left.T @ truth
        even = root / np.linalg.norm(root)  # the mean is fitted as well
        windows = [np.flatnonzero(owner == one) for one in range(len(count))]

        def errors(ridge: float) -> np.ndarray:
            """(W, D), weighed like `truth`."""
            kept = singular**2 / (singular**2 + ridge)
            off = truth - left @ (kept[:, None] * inner)
            for one in windows:
                hat = (left[one] * kept) @ left[one].T + even[one] @ even[one].T
                off[one] = np.linalg.solve(np.eye(len(one)) - hat, off[one])
            return off

        def squared(off: np.ndarray) -> float:
            return float(((off @ metric) * off).sum() / len(count))

        ridge = min(_RIDGES, key=lambda one: squared(errors(one)))
        off = errors(ridge)
        kept = singular / (singular**2 + ridge)
        weight = scale[:, None] * (right.T @ (kept[:, None] * inner))
        for name, value in (("mean", mean), ("weight", weight), ("bias", middle)):
            getattr(self, name).copy_(torch.from_numpy(value))
        return (coefficients - off / root).astype(np.float32), squared(off) ** 0.5
