"""A training step of the garment VAE's network, beside the same network of PyTorch Geometric.

Both have the same weights and take the same batch, a loss that is as simple as possible, and Adam.
PyTorch Geometric gets the batch as one graph of disjoint copies, which is its faster way.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from side_by_side import Comparison, compare
from torch import nn
from torch_geometric.nn import ChebConv
from torch_geometric.utils import scatter

from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.networks import Gcvae, ResidualLevel
from drapeline.models.gcvae.settings import GcvaeNetwork
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology

SIZES = {
    "default size": (8, 16, 32, 64, 64, 128),
    "the paper's": (16, 32, 64, 64, 128, 128),
}
BATCH = 8


class GeometricConv(nn.Module):
    """ChebConv of a union of copies of one graph, with the weights of one of ours."""

    def __init__(self, ours: nn.Module, edges: torch.Tensor, lambda_max: float) -> None:
        super().__init__()
        order, inputs, outputs = ours.weight.shape
        self.conv = ChebConv(inputs, outputs, K=order, normalization="sym")
        self.edges, self.lambda_max = edges, torch.tensor(lambda_max)
        with torch.no_grad():
            self.conv.bias.copy_(ours.bias)
            for layer, weight in zip(self.conv.lins, ours.weight, strict=True):
                layer.weight.copy_(weight.T)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B * N, inputs) -> (B * N, outputs)."""
        return self.conv(x, self.edges, lambda_max=self.lambda_max)


class GeometricBlock(nn.Module):
    """Our residual block on a union of copies."""

    def __init__(self, ours: ResidualLevel, *graph) -> None:
        super().__init__()
        self.first, self.second = (GeometricConv(c, *graph) for c in (ours.first, ours.second))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B * N, F) -> (B * N, width)."""
        x = torch.relu(self.first(x))
        return torch.relu(self.second(x) + x)


class GeometricGcvae(nn.Module):
    """Encoder and decoder on one topology, with the dense layers of ours."""

    def __init__(
        self, ours: Gcvae, edges: Sequence[np.ndarray], parents: Sequence[np.ndarray]
    ) -> None:
        super().__init__()
        graph = ours.graphs["body"]
        self.counts, self.encoder, self.decoder = graph.counts, ours.encoder, ours.decoder
        self.parents = [
            _union(torch.from_numpy(p.astype(np.int64))[None], n)[0]
            for p, n in zip(parents, graph.counts[1:], strict=True)
        ]
        unions = []
        for level, (pairs, nodes) in enumerate(zip(edges, graph.counts, strict=True)):
            both = np.concatenate([pairs, pairs[:, ::-1]]).T.astype(np.int64)
            # Ours keeps 2 L / lambda_max - I; its diagonal tells lambda_max.
            matrix = graph.laplacians[level]
            start, index = matrix.forward_start, matrix.forward_index
            first = matrix.forward_value[: start[1]][index[: start[1]] == 0].sum()
            unions.append((_union(torch.from_numpy(both), nodes), 2 / (1 + float(first))))
        blocks = [
            [GeometricBlock(block, *unions[level]) for level, block in numbered]
            for numbered in (
                list(enumerate(ours.encoder.levels)),
                list(zip(range(len(parents) - 1, -1, -1), ours.decoder.levels, strict=True)),
            )
        ]
        self.down, self.up = map(nn.ModuleList, blocks)
        self.coarsest = GeometricConv(ours.decoder.coarsest, *unions[-1])

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B * V, C) -> code (B, 2 * latent) and outputs (V, B, 4)."""
        for level, block in enumerate(self.down):
            x = block(x)
            if level < len(self.parents):
                nodes = BATCH * self.counts[level + 1]
                x = scatter(x, self.parents[level], dim_size=nodes, reduce="max")
        encoder, decoder = self.encoder, self.decoder
        features = torch.relu(encoder.features(x.view(BATCH, -1)))
        code = encoder.code(features)
        z = torch.cat([code[:, : code.shape[1] // 2], encoder.condition(features)], 1)
        rows = torch.relu(decoder.spread(torch.relu(decoder.features(z))))
        x = rows.view(BATCH * self.counts[-1], -1)
        x = torch.relu(self.coarsest(x) + x)
        for parents, block in zip(self.parents[::-1], self.up, strict=True):
            x = block(x[parents])
        return code, decoder.branches(x.view(BATCH, self.counts[0], -1).transpose(0, 1))


def _union(index: torch.Tensor, nodes: int) -> torch.Tensor:
    """(2 or 1, n) indices of `nodes` nodes, of the disjoint copies of a batch."""
    copies = index[:, None] + nodes * torch.arange(BATCH)[:, None]
    return copies.flatten(1)


def template(results: Path) -> BodyTemplate:
    """The graphs of the experiment's hierarchy; statistics play no part here."""
    topology = load_topology(results / "registration/topology.npz")
    hierarchy = load_hierarchy(results / "registration/hierarchy_segments.npz")
    unused = dict.fromkeys(
        ("offset_std", "base_mean", "base_std", "body_std", "body_basis", "cvar_mean", "cvar_std"),
        np.zeros(0),
    )
    return BodyTemplate(
        edges=hierarchy.edges,
        parents=hierarchy.parents,
        faces={"body": topology.faces, "skirt": topology.skirt_faces},
        offset_mean=topology.rest,
        body_mean=topology.rest,
        **unused,
    )


def _step(network: nn.Module, forward) -> None:
    optimizer = torch.optim.Adam(network.parameters(), fused=True)

    def step() -> None:
        optimizer.zero_grad()
        code, out = forward()
        (code.square().mean() + out.abs().mean()).backward()
        optimizer.step()

    return step


def rows(results: Path) -> Iterator[Comparison]:
    """Both sizes of the networks, on the same hierarchy."""
    body = template(results)
    for name, widths in SIZES.items():
        rng = torch.Generator().manual_seed(0)
        size = GcvaeNetwork(widths=widths, linear_path=False)
        ours = Gcvae(body, size, inputs=6, garment=3, mask=True, rng=rng)
        theirs = GeometricGcvae(ours, body.edges["body"], body.parents["body"])
        vertices = len(body.offset_mean)
        x = torch.randn(vertices, BATCH, 6, generator=rng)
        union = x.transpose(0, 1).flatten(0, 1).contiguous()

        def forward(network=ours, x=x) -> tuple[torch.Tensor, torch.Tensor]:
            code = network.encode({"body": x})
            out = network.decode(code.mean, code.condition, {"body": BATCH})["body"]
            return torch.cat([code.mean, code.log_variance], 1), out

        with torch.no_grad():
            for a, b in zip(forward(), theirs(union), strict=True):
                torch.testing.assert_close(a, b, atol=1e-3, rtol=1e-3)
        yield compare(
            f"a step of the garment VAE, {name}, {BATCH} garments of {vertices:,} vertices",
            "PyTorch Geometric",
            _step(theirs, lambda theirs=theirs, x=union: theirs(x)),
            _step(ours, forward),
            goal=5,
            repeats=5,
            note="the network alone, with a simple loss",
        )
