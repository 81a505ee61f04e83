"""The loss of CLOTH3D equations 3 and 4, and the schedule of its KL term."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F

_SMALL_M = 1e-5


@dataclass(frozen=True)
class GcvaeLoss:
    """Weights and forms of the loss; numbers as printed in CLOTH3D.

    Each term is a mean: offsets over the coordinates of the vertices that count, in units of
    normalised offsets; normals over faces, of the L1 norm of the difference of unit normals; the
    mask over vertices; KL over samples and over the components of z. Read as a sum over z, the
    printed KL weights would leave no information in z (0.25 per nat against an L1 below one).

    Attributes:
        normals: lambda_n.
        mask: lambda_m.
        condition: weight of the regression of cvar^z.
        kl_start: lambda_KL over the first part of training.
        kl_flat_share: length of that part as a share of all epochs; the paper's 50 of 100.
        kl_rise: what lambda_KL gains over one hundredth of training after it.
        kl_max: cap of lambda_KL; the printed schedule ends at 0.25.
        mask_form: "l1" on the mask's probability, or "bce".
        offsets_form: "l1" of normalised offsets, or "distance": the Euclidean distance in
            centimetres, which is the surface error.
        offsets_within: "mask" counts vertices of the true mask only, "all" counts every vertex.
    """

    normals: float = 70.0
    mask: float = 0.1
    condition: float = 1.0
    kl_start: float = 1e-4
    kl_flat_share: float = 0.5
    kl_rise: float = 0.005
    kl_max: float = 0.25
    mask_form: str = "l1"
    offsets_form: str = "l1"
    offsets_within: str = "mask"

    def kl_weight(self, share: float) -> float:
        """lambda_KL once `share` (0 to 1) of training is done."""
        rise = self.kl_rise * 100 * max(share - self.kl_flat_share, 0.0)
        return min(self.kl_start + rise, self.kl_max)


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
