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
from drapeline.models.layers.precision import full_precision

# Seen from the front, left and right halves as one.
_REACH_M, _BOTTOM_M, _TOP_M = 0.95, -1.1, 0.5
_RIDGES = np.logspace(-3, 1, 9)
_FLOOR = 0.3  # of a kind's median deviation: cells that hardly vary do not count as much as others


def map_cells(cell_m: float) -> int:
    """Cells of a map, `cell_m` wide and high."""
    columns, rows = _counts(cell_m)
    return columns * rows


def body_map(
    features: torch.Tensor, values: torch.Tensor, frames: int, cell_m: float
) -> torch.Tensor:
    """Means of values over the cells of a map.

    Args:
        features: (B * T, P, 4) of located points, see `PosedBody.body_relative_points`.
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

    What is not known of a map (NaN) has no say, and values beyond those seen count as the most
    extreme one seen: sparser points, or a body that is a little off, are no reason to extrapolate.

    Args:
        kinds: C, values per cell.
        cells: K, of a map.
        components: D, coefficients.
    """

    def __init__(self, kinds: int, cells: int, components: int) -> None:
        super().__init__()
        for name in ("mean", "scale", "low", "high"):
            self.register_buffer(name, torch.zeros(kinds, cells))
        self.register_buffer("weight", torch.zeros(kinds * cells, components))
        self.register_buffer("bias", torch.zeros(components))

    @full_precision
    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """Maps (B, C, K) -> coefficients (B, D)."""
        gap = ((maps - self.mean) * self.scale).nan_to_num(0.0)
        return gap.clamp(self.low, self.high).flatten(1) @ self.weight + self.bias

    def fit(
        self,
        maps: np.ndarray,
        coefficients: np.ndarray,
        sequence: Sequence[str],
        metric: np.ndarray,
    ) -> tuple[np.ndarray, float]:
        """Fit to windows; every sequence counts the same, however many windows it has.

        The ridge is the one whose predictions for sequences left out of the fit are best. Those
        have a closed form: if H is the matrix that gives predictions from truths, and H_ss its part
        within a sequence, what is left out there errs by (I - H_ss)^-1 times the error of the fit.
        Some arrays of 64-bit floats as large as the maps are made on the way.

        Args:
            maps: (W, C, K).
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
        root = np.sqrt(share)[:, None]
        gap, standard = _standardised(maps, share)
        middle = np.average(coefficients.astype(np.float64), axis=0, weights=share)
        left, singular, right = np.linalg.svd(root * gap, full_matrices=False)
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
        found = {**standard, "weight": right.T @ (kept[:, None] * inner), "bias": middle}
        for name, value in found.items():
            getattr(self, name).copy_(torch.from_numpy(value))
        return (coefficients - off / root).astype(np.float32), squared(off) ** 0.5


def _standardised(maps: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Maps (W, C, K) as the regression sees them, (W, C * K), and `mean`, `scale`, `low`, `high`.

    Args:
        share: (W,) weights of the windows. The weighed mean of what is seen is zero.
    """
    known = ~np.isnan(maps)
    weight = share[:, None, None] * known
    total = weight.sum(axis=0)
    values = np.where(known, maps, 0).astype(np.float64)
    mean = (weight * values).sum(axis=0) / np.where(total > 0, total, 1)
    gap = np.where(known, values - mean, 0)
    deviation = np.sqrt((weight * gap**2).sum(axis=0) / share.sum())
    varies = deviation > 0
    typical = [
        np.median(row[one]) if one.any() else 0.0
        for row, one in zip(deviation, varies, strict=True)
    ]
    floored = np.hypot(deviation, _FLOOR * np.array(typical)[:, None])
    scale = np.divide(1, floored, where=varies, out=np.zeros_like(floored))
    scale /= np.sqrt(max(varies.sum(), 1))
    gap *= scale
    standard = {"mean": mean, "scale": scale, "low": gap.min(axis=0), "high": gap.max(axis=0)}
    return gap.reshape(len(gap), -1), standard
