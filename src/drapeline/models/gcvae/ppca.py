"""Probabilistic PCA of partly missing fields, conditioned by a linear regression.

A field is the offsets of a garment's vertices. Outside the garment's mask there is no offset. Read
as zero, as plain PCA has to, every hem and every end of a sleeve is a jump in the field that costs
components; read as missing, the field is smooth, and what it would be beyond the hem is inferred.
The mask itself can enter as a further channel: blurred over the mesh it becomes a ramp, which is
zero at the hem.

After Tipping and Bishop, "Probabilistic principal component analysis", 1999.
"""

from typing import NamedTuple

import torch
from torch import nn

from drapeline.models.layers.graphs import SparseMatrix

_GRAM_ROWS = 256  # of a symmetric product at once, of which half is left out


class PpcaFit(NamedTuple):
    """Parameters of y = regression(c) + basis z + noise, with z standard normal.

    Attributes:
        regression: (C + 1, V * channels) from conditions and a one.
        basis: (Z, V * channels).
        noise: () variance that the basis leaves unexplained.
    """

    regression: torch.Tensor
    basis: torch.Tensor
    noise: torch.Tensor


def blur_mask(mask: torch.Tensor, laplacian: SparseMatrix, passes: int) -> torch.Tensor:
    """Average a mask over the graph until it is a ramp from -1 outside to 1 inside.

    Args:
        mask: (V, B) bool.
        laplacian: scaled and normalised; half of (1 - laplacian) is a stable averaging step.
        passes: number of steps.

    Returns:
        (V, B), zero at the mask's edge.
    """
    x = mask.to(laplacian.forward_value.dtype)
    total = torch.ones_like(x[:, :1])
    both = torch.cat([x, total], 1)
    for _ in range(passes):
        both = 0.5 * (both - laplacian(both))
    return 2 * both[:, :-1] / both[:, -1:] - 1


def append_one(conditions: torch.Tensor) -> torch.Tensor:
    """(n, C) -> (n, C + 1)."""
    return torch.cat([conditions, torch.ones_like(conditions[:, :1])], 1)


def fit_ppca(
    fields: torch.Tensor,
    known: torch.Tensor,
    conditions: torch.Tensor,
    *,
    latent: int,
    rounds: int,
    ridge: float,
) -> PpcaFit:
    """Fit by turns: fill in what is missing, fit to the filled fields, and so on.

    Args:
        fields: (n, V * channels), arbitrary where not known.
        known: (n, V * channels) bool.
        conditions: (n, C) of zero mean and unit deviation.
        latent: size of z; components beyond those that n samples span are zero.
        rounds: of filling in.
        ridge: weight of the regression's penalty, counted in samples.
    """
    filled = torch.where(known, fields, 0)
    one = append_one(conditions)
    penalty = ridge * torch.eye(one.shape[1], dtype=one.dtype, device=one.device)
    penalty[-1, -1] = 0
    solve = torch.linalg.solve(one.T @ one + penalty, one.T)
    count = min(latent, len(fields) - 1)
    near = None
    for number in range(rounds):
        regression = solve @ filled
        mean = one @ regression
        residual = filled - mean
        near = None if number == rounds - 1 else near  # the last round is exact
        values, near, rows = principal_rows(residual, near, count)
        variance = torch.linalg.vector_norm(residual, dim=1).double().square().mean()
        noise = ((variance - values.sum()) / fields.shape[1]).clamp_min(0)
        # Each direction shrinks by the share of its variance that is noise.
        kept = ((values - noise) / values).nan_to_num().clamp_min(0).to(near.dtype)
        filled = torch.where(known, fields, mean.addmm_(near * kept, rows), out=filled)
    size = ((values - noise).clamp_min(0) / (len(residual) * values)).nan_to_num()
    basis = torch.zeros(latent, fields.shape[1], dtype=residual.dtype, device=residual.device)
    basis[:count] = size.sqrt().to(rows.dtype)[:, None] * rows
    return PpcaFit(regression, basis, noise.to(residual.dtype).clamp_min(1e-6))


def principal_rows(
    fields: torch.Tensor, near: torch.Tensor | None, count: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Largest eigenvalues of F F^T / n, their eigenvectors U and U^T F.

    Args:
        fields: F, (n, V * channels).
        near: (n, count) eigenvectors of fields that differ little, for one step of subspace
            iteration from there (Halko et al. 2011, algorithm 4.4); exact if None.
        count: at most n.

    Returns:
        (count,) float64, (n, count) and (count, V * channels).
    """
    if near is not None:
        near, _ = torch.linalg.qr(fields @ (fields.T @ near))
    rows = fields if near is None else near.T @ fields
    values, vectors = torch.linalg.eigh(_gram(rows).double() / len(fields))
    values, vectors = values.flip(0)[:count], vectors.flip(1)[:, :count].to(fields.dtype)
    return values, vectors if near is None else near @ vectors, vectors.T @ rows


def _gram(rows: torch.Tensor) -> torch.Tensor:
    """(n, n) R R^T of rows (n, W), filled in on and below the diagonal, where `eigh` reads it."""
    gram = rows.new_zeros(len(rows), len(rows))
    for start in range(0, len(rows), _GRAM_ROWS):
        end = start + _GRAM_ROWS
        torch.mm(rows[start:end], rows[:end].T, out=gram[start:end, :end])
    return gram


class Ppca(nn.Module):
    """A fit as a module: the exact posterior of a field, and the field of a code.

    Args:
        vertices: V.
        conditions: C.
        latent: Z, size of z.
        observed: (S,) vertices that the posterior looks at.
        channels: of the fields: three of offsets, and others that are known everywhere.
    """

    def __init__(
        self, vertices: int, conditions: int, latent: int, observed: torch.Tensor, channels: int
    ) -> None:
        super().__init__()
        self.channels = channels
        width = vertices * channels
        self.register_buffer("regression", torch.zeros(conditions + 1, width))
        self.register_buffer("basis", torch.zeros(latent, width))
        self.register_buffer("noise", torch.ones(()))
        self.register_buffer("observed", observed, persistent=False)

    def set_fit(self, fit: PpcaFit) -> None:
        """Copy the parameters of a fit."""
        for name, value in fit._asdict().items():
            getattr(self, name).copy_(value)

    def forward(self, z: torch.Tensor, conditions: torch.Tensor) -> torch.Tensor:
        """(B, Z) and (B, C) -> mean fields (V, channels, B)."""
        field = append_one(conditions) @ self.regression + z @ self.basis
        return field.T.unflatten(0, (-1, self.channels))

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
        basis = self.basis.unflatten(1, (-1, self.channels))[:, self.observed]  # (Z, S, channels)
        residual = (
            fields - self(torch.zeros_like(conditions[:, :1]).expand(-1, latent), conditions)
        )[self.observed]
        field = basis[..., 3:].flatten(1)  # (Z, S * others)
        always = field @ field.T
        mean = residual.new_zeros(latent, len(conditions))
        variance = torch.zeros_like(mean)
        # Frames of a garment share its mask, and so their precision.
        masks, which = torch.unique(mask[self.observed], dim=1, return_inverse=True)
        for number, inside in enumerate(masks.T):
            own = which == number
            offsets = basis[:, inside, :3].flatten(1)  # (Z, 3 M)
            precision = (always + offsets @ offsets.T) / self.noise
            precision.diagonal().add_(1)
            seen = offsets @ residual[inside, :3][..., own].flatten(0, 1) + field @ residual[
                :, 3:, own
            ].flatten(0, 1)
            root = torch.linalg.cholesky(precision)
            mean[:, own] = torch.cholesky_solve(seen / self.noise, root)
            variance[:, own] = torch.cholesky_inverse(root).diagonal()[:, None]
        return mean.T, variance.T.log()
