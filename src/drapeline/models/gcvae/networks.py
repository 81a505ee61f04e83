"""Encoder Psi, decoder Phi and conditioning autoencoder Gamma of the conditional VAE (CLOTH3D 4.2).

A batch may hold both topologies. It comes as one tensor per topology; weights are shared, graphs
and pooling tables are not, and between encoder and decoder, where nodes no longer matter, all
samples are rows of one matrix.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import nn
from torch.nn import functional

from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.settings import GcvaeNetwork
from drapeline.models.layers.graphs import ChebConv, MeshGraph, SparseMatrix, UnpoolConv
from drapeline.models.layers.linear import full_precision, linear
from drapeline.registration.to_body.topology import TOPOLOGIES

# Clamped, so that garments unlike any in training give no infinite variance.
_LOG_VARIANCE_RANGE = (-12.0, 8.0)


class Code(NamedTuple):
    """Output of the encoder for (B,) samples: mean and log_variance (B, latent) of q(z | X, cvar).

    The condition (B, condition) is cvar^z as regressed from the input.
    """

    mean: torch.Tensor
    log_variance: torch.Tensor
    condition: torch.Tensor


_SECOND_SCALE = 0.3  # of initial weights; else features double in size from level to level
_LINEAR_SCALE = 0.2  # likewise, of the linear path into the code


class ResidualLevel(nn.Module):
    """A convolution followed by a residual one."""

    def __init__(self, first: nn.Module, width: int, order: int, rng: torch.Generator) -> None:
        super().__init__()
        self.first = first
        self.second = ChebConv(width, width, order, rng)
        with torch.no_grad():
            self.second.weight.mul_(_SECOND_SCALE)

    def forward(
        self, x: torch.Tensor, operator: nn.Module, laplacian: SparseMatrix
    ) -> torch.Tensor:
        """(n, B, F) -> (N, B, width).

        Args:
            operator: the matrix that the first convolution takes.
            laplacian: of the N nodes.
        """
        x = torch.relu_(self.first(x, operator))
        # In place on rows: to change a view in place, autograd would copy whole gradients.
        rows = self.second.rows(x, laplacian).add_(x.flatten(0, 1))
        return torch.relu_(rows).unflatten(0, x.shape[:2])


class VertexLinear(nn.Module):
    """A linear layer with weights of its own at every vertex, initially zero.

    Unlike a filter, which is the same everywhere and in every direction, it can turn smooth
    features into offsets that follow the surface around the body. Filters learn that far more
    slowly.
    """

    def __init__(self, vertices: int, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(vertices, inputs, outputs))
        self.bias = nn.Parameter(torch.zeros(vertices, 1, outputs))

    @full_precision
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(V, B, inputs) -> (V, B, outputs)."""
        return torch.baddbmm(self.bias, x, self.weight)


@full_precision
def _precise_linear(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """In 32 bits: rounded to 16, offsets of neighbours would differ by what a fold is."""
    return functional.linear(x, weight, bias)


class Encoder(nn.Module):
    """{cvar^z, z} = Psi(X, T): residual levels, max pooling to one node per segment, two heads.

    Args:
        inputs: channels per vertex.
        garment: how many of them, the first ones, are the garment's; the linear path takes those.
        vertices, nodes: of the finest and the coarsest level.
    """

    def __init__(
        self,
        inputs: int,
        garment: int,
        vertices: int,
        nodes: int,
        size: GcvaeNetwork,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.garment = garment
        widths = size.level_widths
        self.levels = nn.ModuleList(
            ResidualLevel(ChebConv(a, b, size.order, rng), b, size.order, rng)
            for a, b in zip([inputs, *widths], widths, strict=False)
        )
        self.features = linear(nodes * widths[-1], size.features, rng)
        self.condition = nn.Sequential(
            linear(size.features, size.features // 2, rng),
            nn.ReLU(),
            linear(size.features // 2, size.condition, rng),
        )
        self.code = linear(size.features, 2 * size.latent, rng)
        with torch.no_grad():  # start near the prior
            self.code.weight[: size.latent].mul_(0.7)
            self.code.weight[size.latent :].mul_(0.1)
        self.linear_path: nn.Linear | None = None
        if size.linear_path:
            self.linear_path = linear(vertices * garment, size.latent, rng)
            with torch.no_grad():
                self.linear_path.weight.mul_(_LINEAR_SCALE)

    def forward(self, graphs: Mapping[str, MeshGraph], inputs: Mapping[str, torch.Tensor]) -> Code:
        """Topology -> (V, B_t, inputs), to the codes of all samples in that order."""
        pooled = [self._pool(graphs[name], x) for name, x in inputs.items()]
        features = torch.relu(self.features(torch.cat(pooled)))
        code, condition = (
            head(features).to(self.code.weight) for head in (self.code, self.condition)
        )
        mean, log_variance = code.chunk(2, dim=1)
        if self.linear_path is not None:
            seen = [x[..., : self.garment].transpose(0, 1).flatten(1) for x in inputs.values()]
            path = self.linear_path
            mean = mean + _precise_linear(torch.cat(seen), path.weight, path.bias)
        return Code(mean, log_variance.clamp(*_LOG_VARIANCE_RANGE), condition)

    def _pool(self, graph: MeshGraph, x: torch.Tensor) -> torch.Tensor:
        for level, block in enumerate(self.levels):
            laplacian = graph.laplacians[level]
            x = block(x, laplacian, laplacian)
            if level < len(graph.pools):
                x = graph.pools[level](x)
        return x.transpose(0, 1).flatten(1)  # (B, nodes * width)


class Decoder(nn.Module):
    """Phi(z, cvar^z): fully connected to one node per segment, then copy unpooling and levels.

    Skip connections lie within its levels and none comes from the encoder, so z and cvar^z are
    all that it needs.

    Args:
        outputs: 3 offset channels, and one more for the mask's logit.
    """

    def __init__(
        self,
        outputs: int,
        vertices: int,
        nodes: int,
        size: GcvaeNetwork,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        widths = size.level_widths
        self.nodes = nodes
        self.features = linear(size.latent + size.condition, size.features, rng)
        self.spread = linear(size.features, nodes * widths[-1], rng)
        self.coarsest = ChebConv(widths[-1], widths[-1], size.order, rng)
        self.levels = nn.ModuleList(
            ResidualLevel(UnpoolConv(a, b, size.order, rng), b, size.order, rng)
            for a, b in zip(widths[:0:-1], widths[-2::-1], strict=True)
        )
        # Both branches are linear in the last features, so one layer computes both.
        self.branches: nn.Module
        if size.vertex_output:
            self.branches = VertexLinear(vertices, widths[0], outputs)
        else:
            self.branches = ChebConv(widths[0], outputs, size.order, rng)
        self.linear_path: nn.Linear | None = None
        if size.linear_path:
            self.linear_path = linear(size.latent + size.condition, vertices * outputs, rng)
            nn.init.zeros_(self.linear_path.weight)

    def forward(
        self, graphs: Mapping[str, MeshGraph], code: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """(B, latent + condition), `counts` rows per topology, to topology -> (V, B_t, outputs)."""
        rows = torch.relu(self.spread(torch.relu(self.features(code))))
        rows = rows.view(len(rows), self.nodes, -1).transpose(0, 1).contiguous()  # (nodes, B, F)
        parts = rows.split(list(counts.values()), dim=1)
        made = {
            name: self._unpool(graphs[name], part.contiguous())
            for name, part in zip(counts, parts, strict=True)
        }
        if self.linear_path is None:
            return made
        (outputs,) = {x.shape[2] for x in made.values()}
        path = self.linear_path
        rows = _precise_linear(code, path.weight, path.bias)
        straight = rows.unflatten(1, (-1, outputs)).transpose(0, 1)
        return {
            name: x + part
            for (name, x), part in zip(
                made.items(), straight.split(list(counts.values()), dim=1), strict=True
            )
        }

    def _unpool(self, graph: MeshGraph, x: torch.Tensor) -> torch.Tensor:
        x = torch.relu(self.coarsest(x, graph.laplacians[-1]) + x)
        for level, block in zip(range(len(self.levels) - 1, -1, -1), self.levels, strict=True):
            x = block(x, graph.unpools[level], graph.laplacians[level])
        if isinstance(self.branches, VertexLinear):
            return self.branches(x)
        return self.branches(x, graph.laplacians[0])


def mesh_graphs(body_template: BodyTemplate, order: int) -> dict[str, MeshGraph]:
    """Topology -> graph."""
    return {
        name: MeshGraph(body_template.edges[name], body_template.parents[name], order)
        for name in TOPOLOGIES
    }


class Gcvae(nn.Module):
    """Encoder and decoder on the graphs of both topologies.

    Args:
        body_template: gives the graphs.
        size: of the layers.
        inputs: channels per vertex of the encoder.
        garment: how many of them, the first ones, are the garment's.
        mask: whether the decoder has a mask branch.
    """

    def __init__(
        self,
        body_template: BodyTemplate,
        size: GcvaeNetwork,
        *,
        inputs: int,
        garment: int,
        mask: bool,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        graphs = mesh_graphs(body_template, size.order)
        self.graphs: Any = nn.ModuleDict(graphs)
        nodes = graphs[TOPOLOGIES[0]].counts[-1]
        vertices = len(body_template.body_mean)
        self.encoder = Encoder(inputs, garment, vertices, nodes, size, rng)
        self.decoder = Decoder(3 + mask, vertices, nodes, size, rng)

    def encode(self, inputs: Mapping[str, torch.Tensor]) -> Code:
        """Topology -> (V, B_t, inputs), to the codes of all samples in that order."""
        return self.encoder(self.graphs, inputs)

    def decode(
        self, z: torch.Tensor, condition: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, B_t, 3 or 4): normalised offsets, and the mask's logit if it has one."""
        return self.decoder(self.graphs, torch.cat([z, condition], 1), counts)


class ConditioningAutoencoder(nn.Module):
    """{cvar, cvar^z} = Gamma(cvar), an autoencoder with one skip connection (CLOTH3D 4.2).

    The skip runs from the input to the middle layer. If it bypassed the middle layer, the
    reconstruction could do without cvar^z, which is all that the other networks see.

    Args:
        inputs: size of cvar.
        hidden, middle: widths of the hidden layers and of cvar^z.
        mean, std: (inputs,) of cvar over the training set.
    """

    def __init__(
        self,
        inputs: int,
        hidden: int,
        middle: int,
        *,
        mean: torch.Tensor,
        std: torch.Tensor,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.into = nn.Sequential(
            linear(inputs, hidden, rng), nn.ReLU(), linear(hidden, middle, rng)
        )
        self.skip = linear(inputs, middle, rng)
        self.out = nn.Sequential(
            linear(middle, hidden, rng), nn.ReLU(), linear(hidden, inputs, rng)
        )
        self.mean: torch.Tensor
        self.std: torch.Tensor
        self.register_buffer("mean", mean.clone())
        self.register_buffer("std", std.clone())

    def normalise(self, cvar: torch.Tensor) -> torch.Tensor:
        """(B, C) -> (B, C) with zero mean and unit deviation over the training set."""
        return (cvar - self.mean) / self.std

    def forward(self, cvar: torch.Tensor) -> torch.Tensor:
        """(B, C) -> cvar^z (B, middle)."""
        x = self.normalise(cvar)
        return self.into(x) + self.skip(x)

    def loss(self, cvar: torch.Tensor) -> torch.Tensor:
        """L1 between normalised cvar and its reconstruction."""
        return (self.out(self(cvar)) - self.normalise(cvar)).abs().mean()
