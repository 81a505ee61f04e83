"""Fully connected layers whose initial weights come from a given generator alone."""

import math

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
