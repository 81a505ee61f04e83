"""The terms of the loss of CLOTH3D equations 3 and 4."""

import torch
import torch.nn.functional as F

_SMALL_M = 1e-5


def kl_nat(mean: torch.Tensor, log_variance: torch.Tensor) -> torch.Tensor:
    """(B, Z) each -> (B,): KL of the normal posterior from the standard normal, summed over z."""
    return 0.5 * (mean**2 + log_variance.exp() - 1 - log_variance).sum(1)


def offset_sums(
    predicted: torch.Tensor, true: torch.Tensor, mask: torch.Tensor | None
) -> torch.Tensor:
    """Sum of |predicted - true| over (V, 3, B), within a mask (V, B), and of how many numbers."""
    error = (predicted - true).abs().sum(1)
    if mask is None:
        return torch.stack([error.sum(), error.new_tensor(3.0 * error.numel())])
    return torch.stack([(error * mask).sum(), 3 * mask.sum().to(error.dtype)])


def distance_sums(
    predicted: torch.Tensor, true: torch.Tensor, mask: torch.Tensor | None
) -> torch.Tensor:
    """Sum of the distances in centimetres between (V, 3, B) metres in a mask (V, B), and count."""
    distance = ((predicted - true).square().sum(1) + _SMALL_M**2).sqrt() * 100
    if mask is None:
        return torch.stack([distance.sum(), distance.new_tensor(float(distance.numel()))])
    return torch.stack([(distance * mask).sum(), mask.sum().to(distance.dtype)])


def normal_sums(predicted: torch.Tensor, true: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Sum of the L1 norm between normals (F, 3, B) over the faces of a mask (F, B), and number."""
    error = (predicted - true).abs().sum(1)
    return torch.stack([(error * faces).sum(), faces.sum().to(error.dtype)])


def mask_sums(logit: torch.Tensor, mask: torch.Tensor, form: str) -> torch.Tensor:
    """Sum over (V, B) of the mask's error in the form asked for, and the number of vertices."""
    true = mask.to(logit.dtype)
    if form == "bce":
        error = F.binary_cross_entropy_with_logits(logit, true, reduction="sum")
    else:
        error = (torch.sigmoid(logit) - true).abs().sum()
    return torch.stack([error, error.new_tensor(float(logit.numel()))])
