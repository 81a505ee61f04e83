"""The conditioning autoencoder Gamma, built by hand."""

from pathlib import Path

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.gcvae.data import cvar_statistics
from drapeline.models.gcvae.networks import ConditioningAutoencoder
from drapeline.models.gcvae.train import load_conditioning
from drapeline.models.training.checkpoints import Checkpoint
from drapeline.models.training.module import BEST

INPUTS, MIDDLE = 6, 4


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.fixture
def gamma():
    mean, std = torch.linspace(-1, 1, INPUTS), torch.linspace(0.5, 2, INPUTS)
    return ConditioningAutoencoder(INPUTS, 8, MIDDLE, mean=mean, std=std, rng=rng()).double()


@pytest.fixture
def cvar():
    return 2 * torch.randn(16, INPUTS, generator=rng(1), dtype=torch.float64)


def test_conditions_are_normalised_by_the_training_set_s_mean_and_deviation(gamma, cvar):
    gamma.mean.copy_(cvar.mean(0))
    gamma.std.copy_(cvar.std(0))
    normalised = gamma.normalise(cvar)
    torch.testing.assert_close(normalised.mean(0), torch.zeros(INPUTS).double())
    torch.testing.assert_close(normalised.std(0), torch.ones(INPUTS).double())


def test_the_middle_layer_is_a_network_beside_a_skip_connection(gamma, cvar):
    normalised = gamma.normalise(cvar)
    expected = gamma.into(normalised) + gamma.skip(normalised)
    torch.testing.assert_close(gamma(cvar), expected)
    with torch.no_grad():
        for parameter in gamma.into.parameters():
            parameter.zero_()
    # What is left is the skip: linear in the conditions.
    a, b = cvar[:8], cvar[8:]
    torch.testing.assert_close(gamma((a + b) / 2), (gamma(a) + gamma(b)) / 2)
    assert gamma(cvar).abs().min() > 0


def test_the_loss_is_l1_of_normalised_conditions_rebuilt_from_the_middle_layer(gamma, cvar):
    rebuilt = gamma.out(gamma(cvar))
    expected = (rebuilt - (cvar - gamma.mean) / gamma.std).abs().mean()
    torch.testing.assert_close(gamma.loss(cvar), expected)


def test_a_network_that_passes_conditions_on_has_no_loss(cvar):
    """Skip to the middle, identity past it: ReLU(x) - ReLU(-x) is x."""
    zeros, ones = torch.zeros(INPUTS), torch.ones(INPUTS)
    gamma = ConditioningAutoencoder(
        INPUTS, 2 * INPUTS, INPUTS, mean=zeros, std=ones, rng=rng()
    ).double()
    eye = torch.eye(INPUTS).double()
    with torch.no_grad():
        for parameter in gamma.parameters():
            parameter.zero_()
        gamma.skip.weight.copy_(eye)
        gamma.out[0].weight.copy_(torch.cat([eye, -eye]))
        gamma.out[2].weight.copy_(torch.cat([eye, -eye], 1))
    assert float(gamma.loss(cvar).detach()) < 1e-12


def test_gradients_by_finite_differences(gamma, cvar):
    assert torch.autograd.gradcheck(gamma.loss, cvar.requires_grad_())


def autoencoder(middle, seed):
    zeros = torch.zeros(INPUTS)
    return ConditioningAutoencoder(INPUTS, 8, middle, mean=zeros, std=zeros + 1, rng=rng(seed))


def test_trained_weights_are_copied_into_an_autoencoder_of_the_same_size(gamma):
    weights = {f"autoencoder.{key}": value for key, value in gamma.state_dict().items()}
    # With what is of the training and not of the autoencoder.
    checkpoint = Checkpoint(weights | {"position": torch.zeros(1)}, {})
    into = autoencoder(MIDDLE, seed=5).double()
    load_conditioning(checkpoint, into, Path(BEST))
    for key, value in gamma.state_dict().items():
        torch.testing.assert_close(into.state_dict()[key], value, rtol=0, atol=0)
    with pytest.raises(InputError, match=f"{BEST}.*another size"):
        load_conditioning(checkpoint, autoencoder(MIDDLE + 1, seed=5), Path(BEST))


def test_a_condition_that_hardly_varies_in_training_is_not_blown_up():
    cvar = np.array([[1, 5, 0.01], [3, 5, -0.01]], dtype=np.float64)
    mean, std = cvar_statistics(cvar)
    np.testing.assert_allclose(mean, [2, 5, 0])
    np.testing.assert_allclose(std, [1, 1, 1])
    assert mean.dtype == std.dtype == np.float32
    np.testing.assert_allclose(cvar_statistics(10 * cvar)[1], [10, 1, 0.1])
