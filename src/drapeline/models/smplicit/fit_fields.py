"""Codes of garments whose distance fields are known at some points, by least squares.

The residuals' absolute values are minimised as weighted squares (iteratively reweighted least
squares), by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963). A code reaches the decoder
through the first joint layer alone, as one summand for all points, so the derivatives by 18 numbers
take a single backward pass, and what the points contribute is computed once.

B garments, P points, Z numbers of a code, H outputs of the first joint layer.
"""

from typing import NamedTuple

import torch

from drapeline.models.layers.precision import full_precision
from drapeline.models.smplicit.decoder import Decoder

# Below them, absolute values are taken for squares: distances in units of d_max, and codes.
_LEAST_RESIDUAL, _LEAST_NUMBER = 0.1, 0.02
_DAMPING, _MORE, _LESS = 0.1, 10.0, 3.0


class _State(NamedTuple):
    """What a code gives.

    Attributes:
        z: (B, Z).
        residual: (B, P).
        slopes: (B, P, Z) derivatives of the residuals.
        loss: (B,).
    """

    z: torch.Tensor
    residual: torch.Tensor
    slopes: torch.Tensor
    loss: torch.Tensor


@full_precision
def fit_codes(
    decoder: Decoder,
    points: torch.Tensor,
    distance: torch.Tensor,
    places: torch.Tensor,
    z: torch.Tensor,
    latent: float,
    steps: int,
) -> torch.Tensor:
    """(B, Z) codes with the least mean error of distances, plus `latent` times their mean size.

    The decoder is left as it is. No code is worse than the one that it started from.

    Args:
        decoder: of the field.
        points: (B, P, 3) metres.
        distance: (B, P) clipped distances, in units of d_max.
        places: (B, K, 3) clusters of the wearers.
        z: (B, Z) to start from.
        latent: lambda_z.
        steps: each takes one pass through the decoder and back.
    """
    z = z.detach()
    with torch.no_grad():
        query = decoder.query(points, *decoder.fold(places))
        known = _look(decoder, query, distance, z, latent)
        damping = z.new_full((len(z), 1), _DAMPING)
        for _ in range(steps):
            step = _step(known, latent, damping)
            tried = _look(decoder, query, distance, known.z - step, latent)
            better = tried.loss < known.loss
            damping = torch.where(better[:, None], damping / _LESS, damping * _MORE)
            chosen = [
                torch.where(better.view(-1, *[1] * (new.ndim - 1)), new, old)
                for new, old in zip(tried, known, strict=True)
            ]
            known = _State(*chosen)
    return known.z


def _look(
    decoder: Decoder, query: torch.Tensor, distance: torch.Tensor, z: torch.Tensor, latent: float
) -> _State:
    z_cut, z_style = z.split([decoder.cut, decoder.style], 1)
    hidden = query + decoder.base(z_cut, z_style)[:, None]
    with torch.enable_grad():
        hidden.requires_grad_(True)
        predicted = decoder.joint(hidden)
        (by_hidden,) = torch.autograd.grad(predicted.sum(), hidden)
    residual = predicted.detach() - distance
    slopes = by_hidden @ decoder.base_slopes(z_style)  # (B, P, H) by (B, H, Z)
    loss = residual.abs().mean(1) + latent * z.abs().mean(1)
    return _State(z, residual, slopes, loss)


def _step(state: _State, latent: float, damping: torch.Tensor) -> torch.Tensor:
    """(B, Z) the way down from a code's number to the solution of the damped normal equations."""
    weight = 1 / state.residual.abs().clamp(min=_LEAST_RESIDUAL) / state.residual.shape[1]
    prior = latent / state.z.shape[1] / state.z.abs().clamp(min=_LEAST_NUMBER)
    weighted = (weight[..., None] * state.slopes).mT
    normal = weighted @ state.slopes + torch.diag_embed(prior)
    down = (weighted @ state.residual[..., None])[..., 0] + prior * state.z
    diagonal = normal.diagonal(dim1=1, dim2=2)
    damped = normal + torch.diag_embed(damping * diagonal + 1e-6)
    return torch.linalg.solve_ex(damped, down).result
