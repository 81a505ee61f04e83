"""The networks of the paper as codecs."""

import pytest
import torch

from drapeline.models.gcvae.vae import StaticVae
from toys.gcvae import VERTICES, toy_template
from toys.gcvae_files import SETTINGS


@pytest.fixture
def model(untrained):
    return untrained


def test_topologies_differ_in_graph_alone(model, batch):
    z = model.encode(batch).mean
    body = model.decode(z, batch["cvar"], torch.zeros(9, dtype=torch.long))[0]
    skirt = model.decode(z, batch["cvar"], torch.ones(9, dtype=torch.long))[0]
    assert not torch.allclose(body, skirt)


def test_without_a_mask_branch_there_are_offsets_only(batch):
    settings = SETTINGS.replace(training={"mask": False})
    model = StaticVae(settings, toy_template())
    z = model.encode(batch).mean
    offsets, mask = model.decode(z, batch["cvar"], batch["topology"])
    assert offsets.shape == (9, VERTICES, 3)
    assert mask is None


def test_same_seed_same_weights():
    first, again = (StaticVae(SETTINGS, toy_template()).state_dict() for _ in range(2))
    other = StaticVae(SETTINGS.replace(training={"seed": 1}), toy_template()).state_dict()
    assert all(torch.equal(first[key], again[key]) for key in first)
    assert not torch.equal(
        first["network.encoder.features.weight"], other["network.encoder.features.weight"]
    )
