"""The canonical stage: which points are the garment's, and what shape the garment has at rest.

T(alpha) = G + C alpha (Garment4D 2.1), where alpha is estimated from the garment's points in all
frames of a window (2.3) and trained by equation 4. The order of the points in a cloud does not
matter: they are first sorted by a hash of their coordinates, so that "the first" of them are a
random but repeatable choice.

Neither the maps of the body in the rest pose nor the closed-form regression on them are part of
Garment4D. A map shows where sleeves and hems end, and how far cloth stands off the body. With a
hundred training garments a linear regression on such maps estimates shapes far better than networks
trained by gradient steps do.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from drapeline.errors import InputError
from drapeline.models.garment4d.settings import CanonicalLayers, CanonicalSettings
from drapeline.models.layers.linear import full_precision, linear
from drapeline.models.layers.point_search import SEARCH_ANEW, Searches, farthest_points, gather_rows
from drapeline.models.layers.pointnet import (
    FeaturePropagation,
    PointLevel,
    RunningNorm,
    SetAbstraction,
    max_pool,
    perceptron,
)
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_template.garment_space import GarmentSpace

# Cell sizes of the maps of the body that labels and coefficients are predicted from.
_LABEL_CELL_M, _SHAPE_CELL_M = 0.05, 0.025
_MAP_WIDTH = 64
# The extent of a map, seen from the front; the left and right halves are laid on one another.
_REACH_M, _BOTTOM_M, _TOP_M = 0.95, -1.1, 0.5
_RIDGES = np.logspace(-3, 1, 9)
_FLOOR = 0.3  # of a channel's median deviation: cells that hardly vary count less than others


class CanonicalOutput(NamedTuple):
    """Output of the stage for B windows of T clouds with P points."""

    # (B, T, P, L) of the labels `outfits.garment_types.LABELS`; None without segmentation.
    logits: torch.Tensor | None
    coefficients: torch.Tensor  # (B, D) alpha
    vertices: torch.Tensor  # (B, N, 3) T(alpha), metres, root frame
    levels: list[PointLevel]  # the garment's points, finest first, of B * T clouds
    # (B, D) that alpha started from; None from a network without a `regression`.
    initial_alpha: torch.Tensor | None = None


def hashed_order(points: torch.Tensor) -> torch.Tensor:
    """Indices (B, P) that sort points (B, P, 3) by a hash of their float32 coordinates.

    The order looks random but depends on the points alone, not on the order they come in.
    """
    bits = (points.detach().float() + 0.0).view(torch.int32).long()  # + 0.0: -0 is 0
    code = bits[..., 0] * 73856093 ^ bits[..., 1] * 19349663 ^ bits[..., 2] * 83492791
    for shift in (32, 29):  # round numbers have zeros as low bits: let high bits reach them
        code = (code ^ (code >> shift)) * -7046029254386353131
    return code.argsort(dim=1)


def input_features(settings: CanonicalSettings) -> int:
    """Features per input point: its coordinates, or its place on the body."""
    return 4 if settings.body_relative_points else 3


def as_level(points: torch.Tensor) -> tuple[PointLevel, torch.Tensor]:
    """Windows (B, T, P, 3 or 7) as B * T clouds in `hashed_order`, and that order."""
    rows = points.flatten(0, 1)
    order = hashed_order(rows[..., :3])
    rows = gather_rows(rows, order)
    places = rows[..., :3].contiguous()
    features = rows[..., 3:] if rows.shape[-1] > 3 else places
    valid = torch.ones(rows.shape[:2], dtype=torch.bool, device=rows.device)
    return PointLevel(places, features, valid), order


class Segmentation(nn.Module):
    """PointNet++ with three abstractions and propagations: features and logits of every point."""

    def __init__(self, settings: CanonicalSettings, rng: torch.Generator) -> None:
        super().__init__()
        levels = settings.scaled_layers()
        self.centres = [level.centres for level in levels.segmentation]
        widths = [input_features(settings), *(level.outputs for level in levels.segmentation)]
        self.down = nn.ModuleList(
            SetAbstraction(inputs, level.radii, level.neighbours, level.widths, rng)
            for inputs, level in zip(widths, levels.segmentation, strict=False)
        )
        self.up = nn.ModuleList()
        coarse = widths.pop()
        for fine, layers in zip(reversed(widths), levels.propagation, strict=True):
            self.up.append(FeaturePropagation(coarse, fine, layers, rng))
            coarse = layers[-1]
        # What tells tops from t-shirts are sleeves, which are out of a ball's reach.
        self.overview = None
        if settings.body_relative_points:
            self.overview = nn.Sequential(
                linear(map_cells(_LABEL_CELL_M), _MAP_WIDTH, rng),
                nn.ReLU(),
                linear(_MAP_WIDTH, levels.segmentation[-1].outputs, rng),
            )
        self.outputs = coarse
        self.head = nn.Sequential(
            perceptron((coarse, coarse // 2), rng), linear(coarse // 2, len(LABELS), rng)
        )

    def forward(
        self, level: PointLevel, frames: int, searches: Searches = SEARCH_ANEW
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """P points of C clouds, T of a window -> features (C, P, outputs), logits (C, P, L)."""
        levels = abstract_levels(level, self.down, self.centres, searches)
        coarse = levels.pop()
        if self.overview is not None:
            heights = body_map(level.features, level.features[..., 3:], frames, _LABEL_CELL_M)
            seen = self.overview(heights).repeat_interleave(frames, dim=0)
            coarse = coarse._replace(features=coarse.features + seen[:, None])
        while levels:
            fine = levels.pop()
            number = len(self.up) - 1 - len(levels)
            features = self.up[number](fine, coarse, searches.within(f"up {number}"))
            coarse = fine._replace(features=features)
        return coarse.features, self.head(coarse.features)


def abstract_levels(
    level: PointLevel,
    down: nn.ModuleList,
    centres: Sequence[int],
    searches: Searches = SEARCH_ANEW,
) -> list[PointLevel]:
    """A level and its abstractions, finest first.

    The farthest points of farthest points are the first of them, so one search serves all levels.

    Args:
        down: abstractions, finest first.
        centres: how many points each of them keeps.
        searches: of this part of the network.
    """
    levels = [level]
    chosen = searches("farthest", farthest_points, level.points, centres[0], level.valid)
    for number, (abstraction, count) in enumerate(zip(down, centres, strict=True)):
        part = searches.within(f"down {number}")
        levels.append(abstraction(levels[-1], chosen[:, :count], part))
        chosen = torch.arange(count, device=chosen.device).expand(len(chosen), -1)
    return levels


class ShapeEncoder(nn.Module):
    """From the points of a garment in T frames, `inputs` features each, to its D coefficients."""

    def __init__(
        self, inputs: int, components: int, layers: CanonicalLayers, rng: torch.Generator
    ) -> None:
        super().__init__()
        self.centres = [level.centres for level in layers.garment]
        self.widths = [inputs, *(level.outputs for level in layers.garment)]
        self.down = nn.ModuleList(
            SetAbstraction(width, level.radii, level.neighbours, level.widths, rng)
            for width, level in zip(self.widths, layers.garment, strict=False)
        )
        self.overall = perceptron((3 + self.widths[-1], *layers.overall), rng)
        width = layers.overall[-1]
        self.seen = RunningNorm(width)
        self.head = perceptron((width, *layers.head), rng)
        self.coefficients = linear(layers.head[-1], components, rng)
        with torch.no_grad():  # start near the mean garment, or near the initial alpha
            self.coefficients.weight.mul_(0.1)

    def forward(
        self, level: PointLevel, frames: int, searches: Searches = SEARCH_ANEW
    ) -> tuple[torch.Tensor, list[PointLevel]]:
        """Level of B * T clouds, T of a window -> coefficients (B, D), and the levels."""
        levels = abstract_levels(level, self.down, self.centres, searches)
        last = levels[-1]
        rows = self.overall(torch.cat([last.points, last.features], dim=-1))
        # Features are not negative, so a cloud without garment points (all zero) has no effect.
        window = max_pool(rows, last.valid).unflatten(0, (-1, frames)).amax(1)
        return self.coefficients(self.head(self.seen(window))), levels


class _ShapeNetwork(nn.Module):
    """A network that ends in T(alpha) = G + C alpha.

    Args:
        space: G and C of the garment's type.

    Attributes:
        regression: estimates the initial alpha of body-relative points; None without such points.
    """

    mean: torch.Tensor
    components: torch.Tensor

    def __init__(self, space: GarmentSpace, settings: CanonicalSettings) -> None:
        super().__init__()
        self.regression: MapRegression | None = None
        if settings.body_relative_points:
            cells = map_cells(_SHAPE_CELL_M)
            self.regression = MapRegression(3, cells, len(space.components))
        self.register_buffer("mean", torch.from_numpy(np.array(space.mean, dtype=np.float32)))
        components = torch.from_numpy(np.array(space.components, dtype=np.float32))
        self.register_buffer("components", components)

    @full_precision
    def vertices(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Alpha (B, D) -> T(alpha) (B, N, 3)."""
        return self.mean + torch.tensordot(coefficients, self.components, dims=1)

    def output(
        self,
        logits: torch.Tensor | None,
        change: torch.Tensor,
        levels: list[PointLevel],
        points: torch.Tensor,
        chosen: torch.Tensor,
        initial_alpha: torch.Tensor | None,
    ) -> CanonicalOutput:
        """The output with alpha: the network's change to the initial one, if it has a `regression`.

        Args:
            logits, levels: of the output.
            change: (B, D) that the network makes; without a regression it is alpha itself.
            points: (B, T, P, 7), body-relative.
            chosen: (B, T, P) bool, the garment's points.
            initial_alpha: (B, D); the estimate of `regression` if None.
        """
        if self.regression is None:
            return CanonicalOutput(logits, change, self.vertices(change), levels)
        if initial_alpha is None:
            initial_alpha = self.regression(self.maps(points, chosen))
        alpha = change + initial_alpha
        return CanonicalOutput(logits, alpha, self.vertices(alpha), levels, initial_alpha)

    def maps(self, points: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
        """The input of `regression` for windows.

        Args:
            points: (B, T, P, 7), body-relative.
            chosen: (B, T, P) bool, which are the garment's.

        Returns:
            (B, 3, cells): share of the points that are the garment's, 0 in cells without points;
            mean distance of the points from the frontal plane, and mean height over the body, NaN
            in cells without points.
        """
        features = points[..., 3:].flatten(0, 1)
        depth, height = features[..., 1].abs(), features[..., 3]
        share = chosen.flatten(0, 1).to(height)
        values = torch.stack([torch.ones_like(height), share, depth, height], dim=-1)
        means = body_map(features, values, points.shape[1], _SHAPE_CELL_M).unflatten(1, (4, -1))
        seen = means[:, :1] > 0
        return torch.cat([means[:, 1:2], means[:, 2:].where(seen, torch.nan)], dim=1)


class CanonicalNetwork(_ShapeNetwork):
    """Segments clouds, and estimates alpha from the points whose label is the garment type's."""

    def __init__(
        self, settings: CanonicalSettings, space: GarmentSpace, label: int, rng: torch.Generator
    ) -> None:
        super().__init__(space, settings)
        self.label = label
        layers = settings.scaled_layers()
        self.garment_points = layers.garment_points
        self.segmentation = Segmentation(settings, rng)
        given = input_features(settings) if settings.body_relative_points else 0
        inputs = self.segmentation.outputs + given
        self.body_relative_points = settings.body_relative_points
        self.encoder = ShapeEncoder(inputs, len(space.components), layers, rng)

    @property
    def level_channels(self) -> list[int]:
        """Features per point of the levels, finest first."""
        return self.encoder.widths

    def choose(self, labels: torch.Tensor) -> torch.Tensor:
        """Mask (...) of the points with these labels (...) that alpha is estimated from."""
        return labels == self.label

    def forward(
        self,
        points: torch.Tensor,
        labels: torch.Tensor | None = None,
        initial_alpha: torch.Tensor | None = None,
        searches: Searches = SEARCH_ANEW,
    ) -> CanonicalOutput:
        """Estimate B garments from windows of T clouds.

        Args:
            points: (B, T, P, 3) metres, root frame; (B, T, P, 7) with `body_relative_points`.
            labels: (B, T, P) int64 to choose the garment's points by instead of the logits.
            initial_alpha: (B, D) to start from instead of the estimate of `regression`.
            searches: among the points of these windows.
        """
        level, order = as_level(points)  # B * T clouds
        features, logits = self.segmentation(
            level, points.shape[1], searches.within("segmentation")
        )
        logits = gather_rows(logits, order.argsort(dim=1)).unflatten(0, points.shape[:2])
        chosen = self.choose(logits.argmax(-1) if labels is None else labels)
        if self.body_relative_points:
            features = torch.cat([features, level.features], dim=-1)
        valid = chosen.flatten(0, 1).gather(1, order)
        garment = first_of(level._replace(features=features, valid=valid), self.garment_points)
        change, levels = self.encoder(garment, points.shape[1], searches.within("garment"))
        return self.output(logits, change, levels, points, chosen, initial_alpha)


class PointNetRegressor(_ShapeNetwork):
    """Baseline PN++ of table 2: alpha from all points, whatever their label."""

    def __init__(
        self, settings: CanonicalSettings, space: GarmentSpace, rng: torch.Generator
    ) -> None:
        super().__init__(space, settings)
        layers = settings.scaled_layers()
        self.encoder = ShapeEncoder(input_features(settings), len(space.components), layers, rng)

    def choose(self, labels: torch.Tensor) -> torch.Tensor:
        """All points, (...) bool."""
        return torch.ones_like(labels, dtype=torch.bool)

    def forward(
        self,
        points: torch.Tensor,
        initial_alpha: torch.Tensor | None = None,
        searches: Searches = SEARCH_ANEW,
    ) -> CanonicalOutput:
        """Estimate B garments from windows of T clouds, see `CanonicalNetwork`."""
        level, _ = as_level(points)
        change, levels = self.encoder(level, points.shape[1], searches)
        everything = torch.ones(points.shape[:3], dtype=torch.bool, device=points.device)
        return self.output(None, change, levels, points, everything, initial_alpha)


def first_of(level: PointLevel, count: int) -> PointLevel:
    """The first `count` valid points of each cloud, padded with zeros where there are fewer."""
    index = (~level.valid).to(torch.uint8).argsort(dim=1, stable=True)[:, :count]
    valid = level.valid.gather(1, index)
    points, features = gather_rows(level.points, index), gather_rows(level.features, index)
    return PointLevel(points * valid[..., None], features * valid[..., None], valid)


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
