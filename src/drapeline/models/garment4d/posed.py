"""The posed stage: displacements that take skinned garments onto the points of every frame.

Features of the garment points and body vertices in balls around each vertex of the current garment
are turned into a displacement by graph convolutions, and the next iteration starts from the moved
garment. Between iterations, frames attend to one another (Garment4D 2.4).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import nn

from drapeline.geometry.mesh import edge_graph, edges
from drapeline.models.garment4d.settings import MgnSettings, PosedSettings
from drapeline.models.layers.graphs import SparseMatrix
from drapeline.models.layers.linear import full_precision, linear, linear_blend_skinning
from drapeline.models.layers.point_search import gather_rows, nearest_neighbours
from drapeline.models.layers.pointnet import Neighbourhoods, PointLevel, max_pool

_PULL_PASSES = 3
_SHARE = 0.3  # of the way to the points that an untrained iteration covers


class PosedNetwork(nn.Module):
    """Proposal-guided hierarchical features, iterative graph convolutions, temporal transformer.

    Starts as the identity: untrained it returns the proposal, apart from the pull of the points.

    Args:
        faces: (F, 3) of the template.
        vertex_count: N.
        level_channels: features per point of each level of garment points.
    """

    def __init__(
        self,
        settings: PosedSettings,
        faces: np.ndarray,
        vertex_count: int,
        level_channels: Sequence[int],
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.settings = settings
        self.adjacency = SparseMatrix(mean_of_neighbours(faces, vertex_count))
        widths = (settings.features,) * settings.ball_layers
        self.garment = nn.ModuleList(
            Neighbourhoods(channels, widths, radius, count, rng)
            for channels, radius, count in zip(
                level_channels, settings.garment_radii_m, settings.garment_counts, strict=True
            )
        )
        self.body = nn.ModuleList(
            Neighbourhoods(3, widths, radius, count, rng)
            for radius, count in zip(settings.body_radii_m, settings.body_counts, strict=True)
            if settings.body_encoder
        )
        inputs = 3 + settings.features * (len(self.garment) + len(self.body))
        inputs += 3 if settings.pull_neighbours else 0
        fused = 0 if settings.transformer == "none" else settings.hidden
        self.graphs, self.attention = nn.ModuleList(), nn.ModuleList()
        self.shares = nn.ParameterList()
        for iteration in range(settings.iterations):
            first = inputs + (fused if iteration else 0)
            self.graphs.append(GraphLayers(first, settings.hidden, settings.layers, rng))
            if settings.pull_neighbours:
                self.shares.append(nn.Parameter(torch.tensor(_SHARE)))
            if iteration and fused:
                self.attention.append(
                    FrameAttention(fused, settings.transformer == "per_vertex", rng)
                )

    def forward(
        self,
        proposal: torch.Tensor,
        levels: Sequence[PointLevel],
        body: torch.Tensor,
        body_normals: torch.Tensor,
    ) -> list[torch.Tensor]:
        """Garments after each iteration.

        Args:
            proposal: (B, T, N, 3) skinned garments, root frame, metres.
            levels: garment points of B * T clouds.
            body, body_normals: (B, T, M, 3) body vertices and outward unit normals.

        Returns:
            `iterations` tensors (B, T, N, 3), the last one is the result.
        """
        size, frames = proposal.shape[:2], proposal.shape[1]
        skin = PointLevel(
            body.flatten(0, 1),
            body_normals.flatten(0, 1),
            torch.ones(body.shape[0] * frames, body.shape[2], dtype=torch.bool, device=body.device),
        )
        garment = proposal.flatten(0, 1)  # (B * T, N, 3)
        looks: list[tuple[Any, PointLevel]] = [(ball, skin) for ball in self.body]
        looks += zip(self.garment, levels, strict=True)
        balls = [(ball, level, ball.ball_search(level)) for ball, level in looks]
        hidden, out = None, []
        for iteration, graph in enumerate(self.graphs):
            features = [garment]
            features += [ball(level, garment, search=search) for ball, level, search in balls]
            if self.settings.pull_neighbours:
                features.append(
                    pull_to_points(
                        levels[0], garment, self.settings.pull_neighbours, self.adjacency
                    )
                )
            rows = torch.cat(features, dim=-1).transpose(0, 1)  # (N, B * T, inputs)
            if iteration and self.attention:
                rows = torch.cat([rows, self.attention[iteration - 1](hidden, frames)], dim=-1)
            hidden, displacement = graph(rows, self.adjacency)
            garment = garment + displacement.transpose(0, 1)
            if self.settings.pull_neighbours:
                garment = garment + self.shares[iteration] * features[-1]
            out.append(garment.unflatten(0, size))
        return out


def pull_to_points(
    level: PointLevel, garment: torch.Tensor, neighbours: int, adjacency: SparseMatrix
) -> torch.Tensor:
    """Smoothed offsets (C, N, 3) from each vertex to the mean of its nearest points.

    Args:
        level: garment points of C clouds.
        garment: (C, N, 3) metres.
        neighbours: number of points.
        adjacency: of `mean_of_neighbours`.
    """
    squared, index = nearest_neighbours(level.points, garment, neighbours, level.valid)
    exists = torch.isfinite(squared)[..., None]  # a cloud may have fewer garment points
    near = (gather_rows(level.points, index) * exists).sum(2)
    count = exists.sum(2)
    offset = torch.where(count > 0, near / count.clamp_min(1) - garment, 0.0).transpose(0, 1)
    for _ in range(_PULL_PASSES):
        offset = adjacency(offset)
    return offset.transpose(0, 1)


class GraphLayers(nn.Module):
    """H' = ReLU(D^-1 (A + I) H W + b) several times, and once without ReLU for the displacement.

    Args:
        inputs: features per vertex.
        hidden: features of the layers between.
        layers: how many, the last one included.
    """

    def __init__(self, inputs: int, hidden: int, layers: int, rng: torch.Generator) -> None:
        super().__init__()
        widths = [inputs, *[hidden] * (layers - 1)]
        self.layers = nn.ModuleList(linear(a, b, rng) for a, b in pairwise(widths))
        self.last = nn.Linear(widths[-1], 3)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(
        self, x: torch.Tensor, adjacency: SparseMatrix
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(N, C, inputs) -> features of the second last layer (N, C, hidden), and (N, C, 3)."""
        layer: Any
        for layer in self.layers:
            # The rows of the matrix sum to 1, so the bias may be added before it; it is applied to
            # whichever of x and x W is narrower.
            wide = layer.in_features > layer.out_features
            x = adjacency(layer(x)) if wide else layer(adjacency(x))
            x = torch.relu(x)
        return x, adjacency(self.last(x))


class FrameAttention(nn.Module):
    """V' = softmax(Q K^T / sqrt(scale)) V among the frames of a window (Garment4D 2.4).

    In the paper, Q, K and V of a frame are the features of all vertices in one row, and the scale
    is T. The products then grow with the number of vertices, so that each frame soon attends to a
    single one. With one attention per vertex the scale is the number of features, as is usual.

    Args:
        width: features per vertex.
        per_vertex: whether each vertex has an attention of its own.
    """

    def __init__(self, width: int, per_vertex: bool, rng: torch.Generator) -> None:
        super().__init__()
        self.per_vertex = per_vertex
        self.projection = linear(width, 3 * width, rng)
        self.projection.register_parameter("bias", None)

    def forward(self, x: torch.Tensor, frames: int) -> torch.Tensor:
        """(N, B * T, width) -> (N, B * T, width)."""
        count, width = len(x), x.shape[-1]
        query, key, value = self.projection(x).unflatten(1, (-1, frames)).chunk(3, dim=-1)
        if self.per_vertex:
            return attend(query, key, value, width).flatten(1, 2)
        query, key, value = (
            part.permute(1, 2, 0, 3).flatten(2) for part in (query, key, value)
        )  # (B, T, N * width)
        rows = attend(query, key, value, frames)
        return rows.unflatten(2, (count, width)).permute(2, 0, 1, 3).flatten(1, 2)


@full_precision
def attend(query: torch.Tensor, key: torch.Tensor, value: torch.Tensor, scale: int) -> torch.Tensor:
    """softmax(Q K^T / sqrt(scale)) V of (..., T, C) each; long products overflow in 16 bits."""
    return torch.softmax(query @ key.mT / scale**0.5, dim=-1) @ value


def mean_of_neighbours(faces: np.ndarray, count: int) -> sparse.csr_matrix:
    """D^-1 (A + I), (N, N): the mean over a vertex and its neighbours."""
    matrix = (edge_graph(edges(faces), count) + sparse.identity(count)).tocsr()
    return (sparse.diags(1 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix).tocsr()


class MgnNetwork(nn.Module):
    """Multi-Garment Net on point clouds: one feature per frame gives all displacements at once.

    The displaced canonical garment of every frame is skinned with the weights of the nearest body
    vertex (K = 1), as in SMPL+D. Untrained, it is skinning alone, but for the pull of the points.

    Args:
        faces: (F, 3) of the template.
        vertex_count: N.
        level_channels: features per point of each level, of which the last is used.
    """

    def __init__(
        self,
        settings: MgnSettings,
        faces: np.ndarray,
        vertex_count: int,
        level_channels: Sequence[int],
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.scale_m, self.pull_neighbours = settings.scale_m, settings.pull_neighbours
        if settings.pull_neighbours:
            self.adjacency = SparseMatrix(mean_of_neighbours(faces, vertex_count))
            self.share = nn.Parameter(torch.tensor(_SHARE))
        self.point = linear(3 + level_channels[-1], settings.widths[0], rng)
        self.layers = nn.ModuleList(linear(a, b, rng) for a, b in pairwise(settings.widths))
        self.last = nn.Linear(settings.widths[-1], 3 * vertex_count)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(
        self,
        canonical: torch.Tensor,
        levels: Sequence[PointLevel],
        weights: torch.Tensor,
        transforms: torch.Tensor,
    ) -> torch.Tensor:
        """Posed garments (B, T, N, 3), root frame, metres.

        Args:
            canonical: (B, N, 3).
            levels: garment points of B * T clouds.
            weights: (B, N, 24) of the nearest body vertices.
            transforms: (B, T, 24, 4, 4), see `linear_blend_skinning`.
        """
        level = levels[-1]
        rows = torch.relu(self.point(torch.cat([level.points, level.features], dim=-1)))
        x = max_pool(rows, level.valid)  # (B * T, widths[0])
        for layer in self.layers:
            x = torch.relu(layer(x))
        moved = self.scale_m * self.last(x).view(*transforms.shape[:2], -1, 3)
        garment = linear_blend_skinning(canonical[:, None] + moved, weights, transforms)
        if not self.pull_neighbours:
            return garment
        clouds = garment.flatten(0, 1)
        pull = pull_to_points(levels[0], clouds, self.pull_neighbours, self.adjacency)
        return garment + self.share * pull.unflatten(0, garment.shape[:2])
