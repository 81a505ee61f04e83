"""Initial weights."""

import math

import torch

from drapeline.models.layers.linear import he_uniform, linear


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def test_weights_come_from_the_generator_alone():
    torch.testing.assert_close(linear(3, 4, rng(5)).weight, linear(3, 4, rng(5)).weight)
    assert not torch.equal(linear(3, 4, rng(5)).weight, linear(3, 4, rng(6)).weight)
    assert not linear(3, 4, rng()).bias.any()


def test_initial_weights_keep_the_second_moment_through_a_relu():
    """For inputs x, E[relu(w x)^2] = E[x^2] when the variance of w is 2 / inputs."""
    weights = he_uniform((400, 300), 300, rng())
    assert weights.abs().max() <= math.sqrt(6 / 300)
    torch.testing.assert_close(weights.var().item(), 2 / 300, rtol=0.02, atol=0)
