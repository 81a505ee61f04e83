"""A linear conditional VAE in closed form: probabilistic PCA of offsets that are partly missing.

Outside a garment's mask there is no offset. Read as zero, as plain PCA must, every hem and every
sleeve end is a jump in the field that costs components; read as missing, the field is smooth and
what it would be beyond the hem is inferred. The mask itself enters as a fourth channel: blurred
over the mesh until it is a ramp, whose half-way line is the hem.
"""

from typing import NamedTuple

import torch
from torch import nn

from drapeline.models.layers.precision import full_precision
from drapeline.models.layers.sparse_matrix import SparseMatrix


class LinearFit(NamedTuple):
    """Parameters of y = mean(c) + basis z + noise, z standard normal.

    Attributes:
        regression: (C + 1, V * channels) from conditions and a one.
        basis: (Z, V * channels).
        noise: () variance of what the basis leaves.
    """

    regression: torch.Tensor
    basis: torch.Tensor
    noise: torch.Tensor


def blurred(mask: torch.Tensor, laplacian: SparseMatrix, passes: int) -> torch.Tensor:
    """(V, B) mask -> (V, B) from -1 to 1: averaged `passes` times over the graph, 0 at its edge.

    Args:
        laplacian: scaled and normalised; half of what it takes off one is a stable average.
    """
    x = mask.to(laplacian.forward_value.dtype)
    total = torch.ones_like(x[:, :1])
    both = torch.cat([x, total], 1)
    for _ in range(passes):
        both = 0.5 * (both - laplacian(both))
    return 2 * both[:, :-1] / both[:, -1:] - 1


def with_one(conditions: torch.Tensor) -> torch.Tensor:
    """(n, C) -> (n, C + 1)."""
    return torch.cat([conditions, torch.ones_like(conditions[:, :1])], 1)


def fit_linear(
    fields: torch.Tensor,
    known: torch.Tensor,
    conditions: torch.Tensor,
    *,
    latent: int,
    rounds: int,
    ridge: float,
) -> LinearFit:
    """Fit by filling in what is missing and fitting again.

    Args:
        fields: (n, V * channels), any number where not known.
        known: (n, V * channels) bool.
        conditions: (n, C) of zero mean and unit deviation.
        latent: size of z; components beyond what n samples span are zero.
        rounds: of filling in.
        ridge: weight of the regression's penalty, in samples.
    """
    filled = torch.where(known, fields, 0)
    one = with_one(conditions)
    penalty = ridge * torch.eye(one.shape[1], dtype=one.dtype, device=one.device)
    penalty[-1, -1] = 0
    count = min(latent, len(fields) - 1)
    for _ in range(rounds):
        regression = torch.linalg.solve(one.T @ one + penalty, one.T @ filled)
        rest = filled - one @ regression
        values, vectors = torch.linalg.eigh((rest @ rest.T / len(rest)).double())
        values, vectors = values.flip(0), vectors.flip(1)
        noise = values[count:].sum() / fields.shape[1]
        # PPCA (Tipping and Bishop): shrink each direction by the noise it holds.
        kept = ((values[:count] - noise) / values[:count]).nan_to_num().clamp_min(0)
        low = (vectors[:, :count] * kept) @ (vectors[:, :count].T @ rest.double())
        filled = torch.where(known, fields, one @ regression + low.to(rest.dtype))
    size = ((values[:count] - noise).clamp_min(0) / (len(rest) * values[:count])).nan_to_num()
    basis = torch.zeros(latent, fields.shape[1], dtype=rest.dtype, device=rest.device)
    basis[:count] = ((vectors[:, :count] * size.sqrt()).T @ rest.double()).to(rest.dtype)
    return LinearFit(regression, basis, noise.to(rest.dtype).clamp_min(1e-6))


class LinearPath(nn.Module):
    """The fitted linear VAE as a module: exact posterior, and the field of a code.

    Args:
        vertices: V.
        conditions: C.
        latent: size of z.
        chosen: (S,) vertices that the posterior looks at.
        channels: of the fields: three of offsets, and others that are known everywhere.
    """

    def __init__(
        self, vertices: int, conditions: int, latent: int, chosen: torch.Tensor, channels: int
    ) -> None:
        super().__init__()
        self.channels = channels
        width = vertices * channels
        self.register_buffer("regression", torch.zeros(conditions + 1, width))
        self.register_buffer("basis", torch.zeros(latent, width))
        self.register_buffer("noise", torch.ones(()))
        self.register_buffer("chosen", chosen, persistent=False)

    def take(self, fit: LinearFit) -> None:
        """Hold a fit."""
        for name, value in fit._asdict().items():
            getattr(self, name).copy_(value)

    @full_precision
    def forward(self, z: torch.Tensor, conditions: torch.Tensor) -> torch.Tensor:
        """(B, Z) and (B, C) -> fields (V, channels, B)."""
        field = with_one(conditions) @ self.regression + z @ self.basis
        return field.T.unflatten(0, (-1, self.channels))

    @full_precision
    def posterior(
        self, fields: torch.Tensor, mask: torch.Tensor, conditions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log variance (B, Z) of z given what is known of the fields.

        Args:
            fields: (V, channels, B).
            mask: (V, B): where the first three channels are known; any others always are.
            conditions: (B, C).
        """
        latent = len(self.basis)
        basis = self.basis.unflatten(1, (-1, self.channels))[:, self.chosen]  # (Z, S, channels)
        rest = (fields - self(torch.zeros_like(conditions[:, :1]).expand(-1, latent), conditions))[
            self.chosen
        ]
        field = basis[..., 3:].flatten(1)  # (Z, S * others)
        always = field @ field.T
        means, variances = [], []
        for sample in range(len(conditions)):
            inside = mask[self.chosen, sample]
            offsets = basis[:, inside, :3].flatten(1)  # (Z, 3 M)
            precision = (always + offsets @ offsets.T) / self.noise
            precision.diagonal().add_(1)
            seen = (
                offsets @ rest[inside, :3, sample].flatten() + field @ rest[:, 3:, sample].flatten()
            )
            root = torch.linalg.cholesky(precision)
            means.append(torch.cholesky_solve((seen / self.noise)[:, None], root)[:, 0])
            variances.append(torch.cholesky_inverse(root).diagonal())
        return torch.stack(means), torch.stack(variances).log()
