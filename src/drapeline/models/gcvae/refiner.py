"""A small graph U-Net that corrects a field over the body, level by level."""

from itertools import pairwise

import torch
from torch import nn

from drapeline.models.gcvae.networks import Residual
from drapeline.models.layers.chebyshev import ChebConv, UnpoolConv
from drapeline.models.layers.mesh_graph import MeshGraph


class Refiner(nn.Module):
    """Down by max pooling, up by copying; each level adds its features from the way down.

    Its input is computed from z and conditions alone, so no skip connection leaks the garment.
    Initially it is the zero function.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        places: int,
        widths: tuple[int, ...],
        order: int,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.down = nn.ModuleList(
            Residual(ChebConv(a, b, order, rng), places, b, order, rng)
            for a, b in zip([inputs, *widths], widths, strict=False)
        )
        self.up = nn.ModuleList(UnpoolConv(b, a, order, rng) for a, b in pairwise(widths))
        self.out = ChebConv(widths[0], outputs, order, rng)
        nn.init.zeros_(self.out.weight)

    def forward(self, graph: MeshGraph, x: torch.Tensor) -> torch.Tensor:
        """(V, B, inputs) -> (V, B, outputs)."""
        kept = []
        for level, block in enumerate(self.down):
            if level:
                x = graph.pools[level - 1](x)
            laplacian = graph.laplacians[level]
            x = block(x, laplacian, laplacian, graph.places(level))
            kept.append(x)
        for level in range(len(self.up) - 1, -1, -1):
            x = torch.relu(self.up[level](x, graph.unpools[level]) + kept[level])
        return self.out(x, graph.laplacians[0])
