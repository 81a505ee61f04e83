"""The canonical stage: which points are the garment's, and what shape the garment has at rest.

T(alpha) = G + C alpha (Garment4D 2.1), where alpha is estimated from the garment's points in all
frames of a window (2.3) and trained by equation 4. The order of the points in a cloud does not
matter: they are first sorted by a hash of their coordinates, so that "the first" of them are a
random but repeatable choice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

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


class CanonicalOutput(NamedTuple):
    """Output of the stage for B windows of T clouds with P points."""

    # (B, T, P, L) of the labels `outfits.garment_types.LABELS`; None without segmentation.
    logits: torch.Tensor | None
    coefficients: torch.Tensor  # (B, D) alpha
    vertices: torch.Tensor  # (B, N, 3) T(alpha), metres, root frame
    levels: list[PointLevel]  # the garment's points, finest first, of B * T clouds


def hashed_order(points: torch.Tensor) -> torch.Tensor:
    """Indices (B, P) that sort points (B, P, 3) by a hash of their float32 coordinates.

    The order looks random but depends on the points alone, not on the order they come in.
    """
    bits = (points.detach().float() + 0.0).view(torch.int32).long()  # + 0.0: -0 is 0
    code = bits[..., 0] * 73856093 ^ bits[..., 1] * 19349663 ^ bits[..., 2] * 83492791
    for shift in (32, 29):  # round numbers have zeros as low bits: let high bits reach them
        code = (code ^ (code >> shift)) * -7046029254386353131
    return code.argsort(dim=1)


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
    """PointNet++ with three abstractions and propagations: features and logits of every point.

    Args:
        layers: as many abstractions as propagations.
        inputs: features of a point.
    """

    def __init__(self, layers: CanonicalLayers, inputs: int, rng: torch.Generator) -> None:
        super().__init__()
        self.centres = [level.centres for level in layers.segmentation]
        widths = [inputs, *(level.outputs for level in layers.segmentation)]
        self.down = nn.ModuleList(
            SetAbstraction(inputs, level.radii, level.neighbours, level.widths, rng)
            for inputs, level in zip(widths, layers.segmentation, strict=False)
        )
        self.up = nn.ModuleList()
        coarse = widths.pop()
        for fine, features in zip(reversed(widths), layers.propagation, strict=True):
            self.up.append(FeaturePropagation(coarse, fine, features, rng))
            coarse = features[-1]
        self.outputs = coarse
        self.head = nn.Sequential(
            perceptron((coarse, coarse // 2), rng), linear(coarse // 2, len(LABELS), rng)
        )

    def forward(
        self,
        level: PointLevel,
        searches: Searches = SEARCH_ANEW,
        overview: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """P points of C clouds -> features (C, P, outputs) and logits (C, P, L).

        Args:
            level: the points.
            searches: among them.
            overview: (C, features) to add to those of the coarsest level.
        """
        levels = abstract_levels(level, self.down, self.centres, searches)
        coarse = levels.pop()
        if overview is not None:
            coarse = coarse._replace(features=coarse.features + overview[:, None])
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
        with torch.no_grad():  # start near the mean garment
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
    """

    mean: torch.Tensor
    components: torch.Tensor

    def __init__(self, space: GarmentSpace) -> None:
        super().__init__()
        self.register_buffer("mean", torch.from_numpy(np.array(space.mean, dtype=np.float32)))
        components = torch.from_numpy(np.array(space.components, dtype=np.float32))
        self.register_buffer("components", components)

    @full_precision
    def vertices(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Alpha (B, D) -> T(alpha) (B, N, 3)."""
        return self.mean + torch.tensordot(coefficients, self.components, dims=1)


class CanonicalNetwork(_ShapeNetwork):
    """Segments clouds, and estimates alpha from the points whose label is the garment type's."""

    def __init__(
        self, settings: CanonicalSettings, space: GarmentSpace, label: int, rng: torch.Generator
    ) -> None:
        super().__init__(space)
        self.label = label
        layers = settings.scaled_layers()
        self.garment_points = layers.garment_points
        self.segmentation = Segmentation(layers, 3, rng)
        components = len(space.components)
        self.encoder = ShapeEncoder(self.segmentation.outputs, components, layers, rng)

    @property
    def level_channels(self) -> list[int]:
        """Features per point of the levels, finest first."""
        return self.encoder.widths

    def forward(
        self,
        points: torch.Tensor,
        labels: torch.Tensor | None = None,
        searches: Searches = SEARCH_ANEW,
    ) -> CanonicalOutput:
        """Estimate B garments from windows of T clouds.

        Args:
            points: (B, T, P, 3) metres, root frame.
            labels: (B, T, P) int64 to choose the garment's points by instead of the logits.
            searches: among the points of these windows.
        """
        level, order = as_level(points)  # B * T clouds
        features, logits = self.segmentation(level, searches.within("segmentation"))
        logits = gather_rows(logits, order.argsort(dim=1)).unflatten(0, points.shape[:2])
        chosen = (logits.argmax(-1) if labels is None else labels) == self.label
        valid = chosen.flatten(0, 1).gather(1, order)
        garment = first_of(level._replace(features=features, valid=valid), self.garment_points)
        alpha, levels = self.encoder(garment, points.shape[1], searches.within("garment"))
        return CanonicalOutput(logits, alpha, self.vertices(alpha), levels)


class PointNetRegressor(_ShapeNetwork):
    """Baseline PN++ of table 2: alpha from all points, whatever their label."""

    def __init__(
        self, settings: CanonicalSettings, space: GarmentSpace, rng: torch.Generator
    ) -> None:
        super().__init__(space)
        self.encoder = ShapeEncoder(3, len(space.components), settings.scaled_layers(), rng)

    def forward(self, points: torch.Tensor, searches: Searches = SEARCH_ANEW) -> CanonicalOutput:
        """Estimate B garments from windows of T clouds, see `CanonicalNetwork`."""
        level, _ = as_level(points)
        alpha, levels = self.encoder(level, points.shape[1], searches)
        return CanonicalOutput(None, alpha, self.vertices(alpha), levels)


def first_of(level: PointLevel, count: int) -> PointLevel:
    """The first `count` valid points of each cloud, padded with zeros where there are fewer."""
    index = (~level.valid).to(torch.uint8).argsort(dim=1, stable=True)[:, :count]
    valid = level.valid.gather(1, index)
    points, features = gather_rows(level.points, index), gather_rows(level.features, index)
    return PointLevel(points * valid[..., None], features * valid[..., None], valid)
