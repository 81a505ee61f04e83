"""Maps of the body at rest that points are carried back to, and regressions on them in closed form.

A map shows where sleeves and hems end, and how far cloth stands off the body. With a hundred
training garments a linear regression on such maps estimates shapes far better than networks trained
by gradient steps do.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from drapeline.errors import InputError
from drapeline.models.layers.linear import full_precision

# The extent of a map, seen from the front; the left and right halves are laid on one another.
_REACH_M, _BOTTOM_M, _TOP_M = 0.95, -1.1, 0.5
SHAPE_CELL_M = 0.025  # of the maps that shapes are estimated from
_RIDGES = np.logspace(-3, 1, 9)
_FLOOR = 0.3  # of a channel's median deviation: cells that hardly vary count less than others


def map_cells(cell_m: float) -> int:
    """Number of cells of a map, each `cell_m` wide and high."""
    columns, rows = _counts(cell_m)
    return columns * rows


def body_map(
    features: torch.Tensor, values: torch.Tensor, frames: int, cell_m: float
) -> torch.Tensor:
    """Means of values over the cells of a map.

    Args:
        features: (B * T, P, 4) last columns of `body_relative_points`.
        values: (B * T, P, C) of the same points.
        frames: T.
        cell_m: width and height of a cell.

    Returns:
        (B, C * cells) over all frames of a window; 0 in a cell without points.
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


def garment_maps(on_body: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
    """Maps of a garment's points in windows, which its shape is estimated from.

    Args:
        on_body: (B, T, P, 4) as from `body_relative_points`.
        chosen: (B, T, P) bool, which points are the garment's.

    Returns:
        (B, 3, cells): share of the points that are the garment's, 0 in cells without points; mean
        distance of the points from the frontal plane, and mean height over the body, NaN in cells
        without points.
    """
    features = on_body.flatten(0, 1)
    depth, height = features[..., 1].abs(), features[..., 3]
    share = chosen.flatten(0, 1).to(height)
    values = torch.stack([torch.ones_like(height), share, depth, height], dim=-1)
    means = body_map(features, values, on_body.shape[1], SHAPE_CELL_M).unflatten(1, (4, -1))
    seen = means[:, :1] > 0
    return torch.cat([means[:, 1:2], means[:, 2:].where(seen, torch.nan)], dim=1)


class MapRegression(nn.Module):
    """Ridge regression from maps to coefficients; its output is 0 until it is fitted.

    Unknown values of a map (NaN) are ignored, and values outside the range seen in training are
    clamped to it: sparser points, or a body that is a little off, are no reason to extrapolate.

    Args:
        channels: C, values per cell.
        cells: K, cells per map.
        components: D, coefficients.
    """

    mean: torch.Tensor
    scale: torch.Tensor
    low: torch.Tensor
    high: torch.Tensor
    weight: torch.Tensor
    bias: torch.Tensor

    def __init__(self, channels: int, cells: int, components: int) -> None:
        super().__init__()
        for name in ("mean", "scale", "low", "high"):
            self.register_buffer(name, torch.zeros(channels, cells))
        self.register_buffer("weight", torch.zeros(channels * cells, components))
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
        """Fit to windows; every sequence has the same weight, however many windows it has.

        The ridge parameter is chosen by leave-one-sequence-out cross-validation, which has a closed
        form: if H is the matrix that maps targets to predictions, and H_ss its block within a
        sequence, the error of a fit without that sequence is (I - H_ss)^-1 times the error of the
        fit with it. Several float64 arrays as large as the maps are needed on the way, and square
        ones with a side of W or C * K, whichever is less.

        Args:
            maps: (W, C, K).
            coefficients: (W, D) true ones.
            sequence: (W,) name of each window's sequence, at least two different ones.
            metric: (D, D), so that e @ metric @ e is the squared error of coefficients off by e.

        Returns:
            (W, D) float32 predictions for each sequence by a fit without it, and the root of the
            mean of their squared errors.

        Raises:
            InputError: all windows are from one sequence.
        """
        _, owner, count = np.unique(sequence, return_inverse=True, return_counts=True)
        if len(count) < 2:
            raise InputError("1 training sequence, expected two or more to fit the maps to")
        share = 1 / count[owner]
        root = np.sqrt(share)[:, None]
        gap, standard = _standardise(maps, share)
        middle = np.average(coefficients.astype(np.float64), axis=0, weights=share)
        rows = root * gap
        # Far faster than singular values; H is left @ diag(top / (squared + ridge)) @ left.T.
        few = len(rows) <= rows.shape[1]
        squared, axes = np.linalg.eigh(rows @ rows.T if few else rows.T @ rows)
        squared = np.maximum(squared, 0)
        left, top = (axes, squared) if few else (rows @ axes, np.ones(len(squared)))
        truth = root * (coefficients - middle)
        inner = left.T @ truth
        even = root / np.linalg.norm(root)  # since the mean is fitted as well
        windows = [np.flatnonzero(owner == one) for one in range(len(count))]

        def errors(ridge: float) -> np.ndarray:
            """(W, D) errors of fits without the sequence, weighted like `truth`."""
            kept = top / (squared + ridge)
            off = truth - left @ (kept[:, None] * inner)
            for one in windows:
                hat = (left[one] * kept) @ left[one].T + even[one] @ even[one].T
                off[one] = np.linalg.solve(np.eye(len(one)) - hat, off[one])
            return off

        def square(off: np.ndarray) -> float:
            return float(((off @ metric) * off).sum() / len(count))

        ridge = min(_RIDGES, key=lambda one: square(errors(one)))
        off = errors(ridge)
        weight = axes @ (inner / (squared + ridge)[:, None])
        fitted = {**standard, "weight": rows.T @ weight if few else weight, "bias": middle}
        for name, value in fitted.items():
            getattr(self, name).copy_(torch.from_numpy(value))
        return (coefficients - off / root).astype(np.float32), square(off) ** 0.5


def _standardise(maps: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Standardised maps (W, C * K) for the regression, and its `mean`, `scale`, `low` and `high`.

    Args:
        maps: (W, C, K), NaN where unknown.
        share: (W,) weights of the windows; the weighted mean of a standardised value is zero.
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
