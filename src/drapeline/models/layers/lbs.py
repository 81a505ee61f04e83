"""Linear blend skinning of garments: the proposals that equation 1 starts from."""

import torch

from drapeline.models.layers.precision import full_precision


@full_precision
def linear_blend_skinning(
    canonical: torch.Tensor, weights: torch.Tensor, transforms: torch.Tensor
) -> torch.Tensor:
    """Garments moved by their skinning weights; differentiable in every argument.

    Args:
        canonical: (B, N, 3) in the rest pose, root frame, metres; or (B, T, N, 3) where each
            frame has a garment of its own.
        weights: (B, N, 24), rows sum to 1.
        transforms: (B, T, 24, 3 or 4, 4) motion of each joint's part from the rest pose, as
            `bodies.rest_body.rest_to_pose` has it; a fourth row is not looked at.

    Returns:
        (B, T, N, 3) metres, root frame.
    """
    rows = transforms[..., :3, :].permute(0, 1, 3, 4, 2)  # (B, T, 3, 4, 24)
    blended = (rows.flatten(1, 3) @ weights.mT).unflatten(1, (-1, 3, 4))  # (B, T, 3, 4, N)
    points = canonical if canonical.dim() == 4 else canonical[:, None]
    planes = points.mT  # (B, T or 1, 3, N)
    moved = blended[:, :, :, 3]
    for axis in range(3):
        moved = torch.addcmul(moved, blended[:, :, :, axis], planes[:, :, axis, None])
    return moved.mT.contiguous()
