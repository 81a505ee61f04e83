"""Layers of PointNet++ (Qi et al. 2017): features of points from the points around them.

Nothing here normalises over a batch, so a batch gives what its clouds give one by one. Features are
normalised point by point after the maximum over a neighbourhood, where rows are few; features
pooled from a whole window are normalised by running statistics of the training.
"""

from collections.abc import Sequence
from functools import reduce
from itertools import pairwise
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from drapeline.models.layers.linear import full_precision, linear
from drapeline.models.layers.point_search import (
    SEARCH_ANEW,
    BallSearch,
    Searches,
    gather_rows,
    nearest_neighbours,
    row_numbers,
)

_SMALL = 1e-8
_MOMENTUM, _FLOOR = 0.02, 1e-4


class PointLevel(NamedTuple):
    """A point set per cloud, with features."""

    points: torch.Tensor  # (B, n, 3) metres
    features: torch.Tensor  # (B, n, C), zero where a point is not valid
    valid: torch.Tensor  # (B, n) bool, false for padding


class Neighbourhoods(nn.Module):
    """max_j h([(x_j - c) / r, f_j]) over points x_j in the ball of radius r around each centre c.

    h is a perceptron with a ReLU after each layer. Its first layer is linear in the point and in
    the centre, so it is computed once for each of them and not once for each pair.

    Args:
        inputs: features per point.
        widths: of the layers of h.
        radius: r, metres.
        count: maximum number of points per ball, see `BallSearch`.
    """

    def __init__(
        self, inputs: int, widths: Sequence[int], radius: float, count: int, rng: torch.Generator
    ) -> None:
        super().__init__()
        self.radius = radius
        self.count = count
        self.first = linear(3 + inputs, widths[0], rng)
        self.others = nn.ModuleList(linear(a, b, rng) for a, b in pairwise(widths))

    def forward(
        self,
        level: PointLevel,
        centres: torch.Tensor,
        searches: Searches = SEARCH_ANEW,
        search: BallSearch | None = None,
    ) -> torch.Tensor:
        """Features (B, Q, widths[-1]) at centres (B, Q, 3); zero where no point is valid.

        `search` is this layer's `ball_search(level)`, kept by callers that look around several sets
        of centres; made anew if None.
        """
        place, feature = self.first.weight[:, :3] / self.radius, self.first.weight[:, 3:]
        points = project(level.points, place)
        points = points + F.linear(level.features, feature, self.first.bias)
        middle = project(centres, place)
        index = searches("ball", search or self.ball_search(level), centres, self.count)
        if self.others:
            rows = gather_rows(points, index) - middle[:, :, None]  # (B, Q, count, widths[0])
            for layer in self.others:
                rows = layer(rows.relu_())
            rows = largest(rows)
        else:
            rows = largest_of_rows(points, index) - middle
        return rows.relu() * level.valid.any(1)[:, None, None]

    def ball_search(self, level: PointLevel) -> BallSearch:
        """The search for a level's points in balls of this radius."""
        return BallSearch(level.points, self.radius, level.valid)


def largest(rows: torch.Tensor) -> torch.Tensor:
    """(B, Q, n, C) -> (B, Q, C)."""
    # Without a gradient this is several times as fast on a processor as `max` or `amax`.
    return rows.max(2).values if rows.requires_grad else reduce(torch.maximum, rows.unbind(2))


def largest_of_rows(rows: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """`largest` of the rows (B, P, C) at indices (B, Q, n), which are not copied, (B, Q, C)."""
    index, rows = row_numbers(rows, index), rows.flatten(0, 1)
    if rows.requires_grad:
        most = F.embedding_bag(index.flatten(0, 1), rows, mode="max")
        return most.unflatten(0, index.shape[:2])
    return reduce(torch.maximum, (F.embedding(one, rows) for one in index.unbind(2)))


@full_precision
def project(points: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """(B, n, 3) -> (B, n, C), exact enough to tell the points of one ball apart."""
    return F.linear(points, weight)


class SetAbstraction(nn.Module):
    """Features of neighbourhoods of several radii, counts and widths around some of the points."""

    def __init__(
        self,
        inputs: int,
        radii: Sequence[float],
        counts: Sequence[int],
        widths: Sequence[Sequence[int]],
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.scales = nn.ModuleList(
            Neighbourhoods(inputs, layers, radius, count, rng)
            for radius, count, layers in zip(radii, counts, widths, strict=True)
        )
        self.outputs = sum(layers[-1] for layers in widths)
        self.norm = nn.LayerNorm(self.outputs)

    def forward(
        self, level: PointLevel, chosen: torch.Tensor, searches: Searches = SEARCH_ANEW
    ) -> PointLevel:
        """The level of the points at indices (B, Q)."""
        centres, valid = gather_rows(level.points, chosen), level.valid.gather(1, chosen)
        scales = [
            scale(level, centres, searches.within(f"scale {number}"))
            for number, scale in enumerate(self.scales)
        ]
        features = torch.cat(scales, dim=-1)
        return PointLevel(centres, self.norm(features) * valid[..., None], valid)


class FeaturePropagation(nn.Module):
    """Features of a coarse level at the points of a fine one, joined with those of the fine one.

    The three nearest coarse points are weighted by their inverse squared distances. The
    interpolation is linear, so the first layer is applied before it, where points are fewer.

    Args:
        coarse, fine: features per point of the two levels.
        widths: of the layers.
    """

    def __init__(self, coarse: int, fine: int, widths: Sequence[int], rng: torch.Generator) -> None:
        super().__init__()
        self.coarse = coarse
        self.first = linear(coarse + fine, widths[0], rng)
        self.norm = nn.LayerNorm(widths[0])
        self.others = perceptron(widths, rng)

    def forward(
        self, fine: PointLevel, coarse: PointLevel, searches: Searches = SEARCH_ANEW
    ) -> torch.Tensor:
        """Features (B, n, widths[-1]) at the n points of the fine level."""
        rows = F.linear(coarse.features, self.first.weight[:, : self.coarse])
        own = F.linear(fine.features, self.first.weight[:, self.coarse :], self.first.bias)
        features = interpolate(coarse._replace(features=rows), fine.points, searches) + own
        return self.others(self.norm(features).relu())


def interpolate(
    level: PointLevel, places: torch.Tensor, searches: Searches = SEARCH_ANEW
) -> torch.Tensor:
    """Features (B, Q, C) at places (B, Q, 3) from the three nearest points of each cloud."""
    squared, index = searches("nearest", nearest_neighbours, level.points, places, 3, level.valid)
    share = 1 / (squared + _SMALL)
    share = (share / share.sum(-1, keepdim=True).clamp_min(_SMALL)).to(level.features.dtype)
    return (gather_rows(level.features, index) * share[..., None]).sum(-2)


def perceptron(widths: Sequence[int], rng: torch.Generator) -> nn.Sequential:
    """Linear layers from widths[0] to widths[-1], each with a LayerNorm and a ReLU after it."""
    layers: list[nn.Module] = []
    for a, b in pairwise(widths):
        layers += [linear(a, b, rng), nn.LayerNorm(b), nn.ReLU()]
    return nn.Sequential(*layers)


class RunningNorm(nn.Module):
    """Features standardised by their running mean and deviation in training.

    Most of a feature pooled from a whole cloud is the same for all garments; standardised, the
    differences are left for the next layer. Statistics change in training with gradients alone.
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        self.mean: torch.Tensor
        self.square: torch.Tensor
        self.steps: torch.Tensor
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("square", torch.ones(features))
        self.register_buffer("steps", torch.zeros(()))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C) -> (B, C)."""
        if self.training and torch.is_grad_enabled():
            with torch.no_grad():
                self.steps += 1
                share = torch.clamp(1 / self.steps, min=_MOMENTUM)
                self.mean += share * (x.mean(0) - self.mean)
                self.square += share * (((x - self.mean) ** 2).mean(0) - self.square)
        return (x - self.mean) / (self.square + _FLOOR).sqrt()


def max_pool(features: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Largest features (B, C) over the valid of (B, n, C) points; zero if there is none."""
    most = features.masked_fill(~valid[..., None], -torch.inf).amax(1)
    return most.masked_fill(~valid.any(1, keepdim=True), 0)
