"""Encoder Psi and decoder Phi of the graph-convolutional conditional VAE (CLOTH3D 4.2).

A batch may hold both topologies. It comes as one tensor per topology; weights are shared, graphs
and pooling tables are not, and between encoder and decoder, where nodes no longer matter, all
samples are rows of one matrix.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from drapeline.geometry.mesh import vertex_normals
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.layers.chebyshev import ChebConv, UnpoolConv
from drapeline.models.layers.linear import linear
from drapeline.models.layers.mesh_graph import MeshGraph
from drapeline.models.layers.precision import full_precision
from drapeline.registration.to_body.topology import TOPOLOGIES

# Garments unlike any in training must not give infinite variance.
_LOG_VARIANCE = (-12.0, 8.0)


@dataclass(frozen=True)
class GcvaeNetwork:
    """Sizes of the networks; CLOTH3D gives latent, order and levels, the widths are ours.

    Attributes:
        widths: features per node at each level, finest first.
        scale: factor on the widths of all levels but the finest; the DVAE doubles.
        features: width of the first fully connected layer of the encoder.
        latent: size of z.
        condition: size of cvar^z.
        order: K, the Chebyshev order; 1 means two terms.
    """

    widths: tuple[int, ...] = (16, 32, 64, 64, 128, 128)
    scale: int = 1
    features: int = 256
    latent: int = 128
    condition: int = 32
    order: int = 1

    @property
    def level_widths(self) -> list[int]:
        """Features per node after scaling: the first and last layers keep theirs."""
        return [self.widths[0], *(self.scale * width for width in self.widths[1:])]


class Code(NamedTuple):
    """What the encoder makes of (B,) samples.

    Attributes:
        mean, log_variance: (B, latent) of q(z | X, cvar).
        condition: (B, condition) cvar^z as regressed from the input.
    """

    mean: torch.Tensor
    log_variance: torch.Tensor
    condition: torch.Tensor


_SECOND = 0.3
_LEAST_SHARE = 0.1


class Residual(nn.Module):
    """A convolution, and one whose output is added to its input.

    Filters are isotropic and shared by all nodes, so alone they cannot tell where on the body, or
    on which side of a limb, a node is; `places` are constant inputs that say so.
    """

    def __init__(
        self, first: nn.Module, places: int, width: int, order: int, rng: torch.Generator
    ) -> None:
        super().__init__()
        self.first = first
        self.places = linear(places, width, rng)
        self.second = ChebConv(width, width, order, rng)
        with torch.no_grad():  # or features double in size from level to level
            self.second.weight.mul_(_SECOND)

    def forward(
        self, x: torch.Tensor, operator: nn.Module, laplacian: nn.Module, places: torch.Tensor
    ) -> torch.Tensor:
        """(n, B, F) -> (N, B, width).

        Args:
            operator: what the first convolution needs.
            places: (N, P).
        """
        x = torch.relu_(self.first(x, operator) + self.places(places)[:, None])
        # In place on rows: autograd would copy whole gradients for a change of a view.
        rows = self.second.rows(x, laplacian).add_(x.flatten(0, 1))
        return torch.relu_(rows).unflatten(0, x.shape[:2])


class VertexLinear(nn.Module):
    """A linear layer with weights of its own at every vertex; begins as zero.

    As the normalisation of the offsets, which it undoes in part, it is no filter: from smooth
    features it makes offsets that turn around the body with the surface, which filters that are
    the same everywhere and in every direction learn far more slowly.
    """

    def __init__(self, vertices: int, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(vertices, inputs, outputs))
        self.bias = nn.Parameter(torch.zeros(vertices, 1, outputs))

    @full_precision
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(V, B, inputs) -> (V, B, outputs)."""
        return torch.baddbmm(self.bias, x, self.weight)


class Encoder(nn.Module):
    """{cvar^z, z} = Psi(X, T): residual levels, max pooling to one node per segment, two heads."""

    def __init__(
        self, inputs: int, nodes: int, places: int, size: GcvaeNetwork, rng: torch.Generator
    ) -> None:
        super().__init__()
        widths = size.level_widths
        self.levels = nn.ModuleList(
            Residual(ChebConv(a, b, size.order, rng), places, b, size.order, rng)
            for a, b in zip([inputs, *widths], widths, strict=False)
        )
        self.register_buffer("mean", torch.zeros(nodes * widths[-1]))
        self.register_buffer("std", torch.ones(nodes * widths[-1]))
        self.features = linear(nodes * widths[-1], size.features, rng)
        self.condition = nn.Sequential(
            linear(size.features, size.features // 2, rng),
            nn.ReLU(),
            linear(size.features // 2, size.condition, rng),
        )
        self.code = linear(size.features, 2 * size.latent, rng)
        with torch.no_grad():  # begin near the prior's mean with small variance
            self.code.weight[: size.latent].mul_(0.7)
            self.code.weight[size.latent :].mul_(0.1)
            self.code.bias[size.latent :].fill_(-4)

    def forward(self, graphs: nn.ModuleDict, inputs: Mapping[str, torch.Tensor]) -> Code:
        """Topology -> (V, B_t, inputs), to the codes of all samples in that order."""
        rows = (self.pooled(graphs, inputs) - self.mean) / self.std
        features = torch.relu(self.features(rows))
        code, condition = (head(features).to(self.mean) for head in (self.code, self.condition))
        mean, log_variance = code.chunk(2, dim=1)
        return Code(mean, log_variance.clamp(*_LOG_VARIANCE), condition)

    def pooled(self, graphs: nn.ModuleDict, inputs: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Features of the coarsest nodes, (B, nodes * width), before they are normalised."""
        return torch.cat([self._pooled(graphs[name], x) for name, x in inputs.items()])

    @torch.no_grad()
    def normalise_by(self, graphs: nn.ModuleDict, inputs: Mapping[str, torch.Tensor]) -> None:
        """Let the initial features of a first batch have zero mean and unit deviation.

        Most of a pooled feature is the same for all garments; without this the differences
        between them are too small a part of what the code is made from for training to find.
        """
        rows = self.pooled(graphs, inputs)
        self.mean.copy_(rows.mean(0))
        self.std.copy_(rows.std(0).clamp_min(_LEAST_SHARE * rows.std()))

    def _pooled(self, graph: MeshGraph, x: torch.Tensor) -> torch.Tensor:
        for level, block in enumerate(self.levels):
            laplacian = graph.laplacians[level]
            x = block(x, laplacian, laplacian, graph.places(level))
            if level < len(graph.pools):
                x = graph.pools[level](x)
        return x.transpose(0, 1).flatten(1)  # (B, nodes * width)


class Decoder(nn.Module):
    """Phi(z, cvar^z): fully connected to one node per segment, then copy unpooling and levels.

    Its skip connections lie inside its levels and none comes from the encoder, so z and cvar are
    all it needs.

    Args:
        outputs: 3 offset channels, and one more for the mask's logit.
    """

    def __init__(
        self,
        outputs: int,
        vertices: int,
        nodes: int,
        places: int,
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
            Residual(UnpoolConv(a, b, size.order, rng), places, b, size.order, rng)
            for a, b in zip(widths[:0:-1], widths[-2::-1], strict=True)
        )
        # Both branches are linear in the last features, so one layer makes both.
        self.branches = VertexLinear(vertices, widths[0], outputs)

    def forward(
        self, graphs: nn.ModuleDict, code: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """(B, latent + condition), `counts` rows per topology, to topology -> (V, B_t, outputs)."""
        rows = torch.relu(self.spread(torch.relu(self.features(code))))
        rows = rows.view(len(rows), self.nodes, -1).transpose(0, 1).contiguous()  # (nodes, B, F)
        parts = rows.split(list(counts.values()), dim=1)
        return {
            name: self._unpooled(graphs[name], part.contiguous())
            for name, part in zip(counts, parts, strict=True)
        }

    def _unpooled(self, graph: MeshGraph, x: torch.Tensor) -> torch.Tensor:
        x = torch.relu(self.coarsest(x, graph.laplacians[-1]) + x)
        for level, block in zip(range(len(self.levels) - 1, -1, -1), self.levels, strict=True):
            x = block(x, graph.unpools[level], graph.laplacians[level], graph.places(level))
        return self.branches(x)


PLACES = 6


def graphs_of(body_template: BodyTemplate, order: int) -> nn.ModuleDict:
    """Topology -> graph; places are position and normal on the mean rest body."""
    graphs = {}
    for name in TOPOLOGIES:
        position = body_template.body_mean - body_template.body_mean.mean(axis=0)
        normal = vertex_normals(body_template.body_mean, body_template.faces[name])
        places = np.concatenate([position / position.std(), normal], axis=1)
        graphs[name] = MeshGraph(
            body_template.edges[name], body_template.parents[name], order, places
        )
    return nn.ModuleDict(graphs)


class Gcvae(nn.Module):
    """Encoder and decoder on the graphs of both topologies.

    Args:
        body_template: gives the graphs.
        size: of the layers.
        inputs: channels per vertex of the encoder.
        mask: whether the decoder has a mask branch.
        rng: source of the initial weights.
    """

    def __init__(
        self,
        body_template: BodyTemplate,
        size: GcvaeNetwork,
        *,
        inputs: int,
        mask: bool,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.graphs = graphs_of(body_template, size.order)
        nodes = self.graphs[TOPOLOGIES[0]].counts[-1]
        self.encoder = Encoder(inputs, nodes, PLACES, size, rng)
        self.decoder = Decoder(3 + mask, len(body_template.offset_mean), nodes, PLACES, size, rng)

    def normalise_by(self, inputs: Mapping[str, torch.Tensor]) -> None:
        """Set the encoder's constants from a first batch; see there."""
        self.encoder.normalise_by(self.graphs, inputs)

    def encode(self, inputs: Mapping[str, torch.Tensor]) -> Code:
        """Topology -> (V, B_t, inputs), to the codes of all samples in that order."""
        return self.encoder(self.graphs, inputs)

    def decode(
        self, z: torch.Tensor, condition: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, B_t, 3 or 4): normalised offsets, and the mask's logit if it has one."""
        return self.decoder(self.graphs, torch.cat([z, condition], 1), counts)
