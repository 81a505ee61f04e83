"""Toy garments, an untrained network, types told by a code's first number, conditions."""

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.codec import Codes, decode_codes
from drapeline.models.gcvae.load import TrainingCodes, mask_rates
from drapeline.models.gcvae.ppca import StaticPpca
from drapeline.models.gcvae.sample import fit_types
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.training.batches import as_tensors
from drapeline.seeding import rng_for
from toys.gcvae import DRESS, TROUSERS, ToyGarments, half, toy_template
from toys.gcvae_files import SETTINGS, TypedGarments, shaken
from toys.gcvae_trainings import train_condition


@pytest.fixture(scope="module")
def garments():
    return TypedGarments()


@pytest.fixture(scope="module")
def model():
    return shaken(StaticVae(SETTINGS, toy_template()))


@pytest.fixture(scope="module")
def types():
    """Dresses cover the upper half, with codes about 3 in the first number; trousers the rest."""
    rng = rng_for(0, "codes")
    garment = np.repeat([DRESS, TROUSERS], 100)
    mean = rng.normal(size=(200, 5)) * 0.5
    mean[:, 0] += np.where(garment == DRESS, 3, -3)
    mask = np.stack([half(garment_index == DRESS) for garment_index in garment])
    codes = Codes(mean, np.full((200, 5), -6.0))
    rate = mask_rates(garment, mask, np.arange(200))
    return fit_types(TrainingCodes(codes, garment, np.zeros((200, 13)), rate))


@pytest.fixture
def halves(monkeypatch):
    """A decoder whose mask is the upper half where the code's first number is positive."""

    def decoded(model, z, *rest):
        for code, (offsets, mask) in zip(z, decode_codes(model, z, *rest), strict=True):
            mask[:] = half(code[0] > 0)
            yield offsets, mask

    monkeypatch.setattr("drapeline.models.gcvae.sample.decode_codes", decoded)


@pytest.fixture(scope="package")
def conditioning(tmp_path_factory):
    """Folder of a trained conditioning autoencoder."""
    folder = tmp_path_factory.mktemp("conditioning")
    return train_condition(folder / "out", ToyGarments())


@pytest.fixture(scope="package")
def untrained():
    """An untrained network with a last layer that is not zero."""
    model = StaticVae(SETTINGS, toy_template()).eval()
    weight = model.network.decoder.branches.weight
    torch.nn.init.normal_(weight, std=0.3, generator=torch.Generator().manual_seed(0))
    return model


@pytest.fixture(scope="package")
def fitted():
    """Masked PCA of the toy garments."""
    model = StaticPpca(PpcaSettings(latent=8), toy_template())
    model.fit(ToyGarments())
    return model.eval()


@pytest.fixture(scope="package")
def batch():
    """Nine toy garments of both topologies."""
    batch = as_tensors(ToyGarments().batch(np.arange(9)))
    assert 0 < batch["topology"].sum() < 9
    return batch
