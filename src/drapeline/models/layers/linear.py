"""Linear maps: layers whose initial weights come from a given generator, and skinning."""

import math
from collections.abc import Callable
from functools import wraps
from typing import Any

import torch
from torch import nn


def he_uniform(shape: tuple[int, ...], inputs: int, rng: torch.Generator) -> torch.Tensor:
    """Uniform initial weights that keep the variance through a ReLU (He et al., ICCV 2015).

    Args:
        shape: of the weights.
        inputs: numbers that each output is a sum over (the "fan in").
        rng: source of the weights.
    """
    bound = math.sqrt(6 / inputs)
    return (2 * torch.rand(shape, generator=rng) - 1) * bound


def linear(inputs: int, outputs: int, rng: torch.Generator) -> nn.Linear:
    """A fully connected layer whose initial weights come from `rng` alone."""
    layer = nn.utils.skip_init(nn.Linear, inputs, outputs)
    with torch.no_grad():
        layer.weight.copy_(he_uniform((outputs, inputs), inputs, rng))
        layer.bias.zero_()
    return layer


def full_precision(function: Callable[..., Any]) -> Callable[..., Any]:
    """Run a function of tensors outside autocast, with 16-bit arguments widened to 32 bits.

    For geometry: rounded to bfloat16, coordinates around one metre are off by up to 4 mm.
    """

    @wraps(function)
    def run(*values: Any) -> Any:
        device = next(x.device.type for x in values if isinstance(x, torch.Tensor))
        if not torch.is_autocast_enabled(device):
            return function(*values)
        with torch.autocast(device, enabled=False):
            return function(*map(_widen, values))

    return run


def _widen(value: Any) -> Any:
    narrow = isinstance(value, torch.Tensor) and value.dtype in (torch.float16, torch.bfloat16)
    return value.float() if narrow else value


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
