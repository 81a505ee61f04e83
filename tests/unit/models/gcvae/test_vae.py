"""What the VAEs must not depend on, and what they need."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.vae import StaticVae
from gcvae_files import SETTINGS
from gcvae_toys import VERTICES, toy_domain


def rows_of(batch, rows):
    return {
        key: [value[i] for i in rows] if isinstance(value, list) else value[torch.tensor(rows)]
        for key, value in batch.items()
    }


@pytest.fixture
def model(prepared_model):
    return prepared_model


def test_a_batch_is_its_samples_one_by_one(model, batch):
    code = model.encode(batch)
    offsets, mask = model.decode(code.mean, batch["cvar"], batch["topology"])
    assert offsets.shape == (9, VERTICES, 3)
    assert mask.shape == (9, VERTICES)
    for row in range(9):
        one = rows_of(batch, [row])
        alone = model.encode(one)
        for part, whole in zip(alone, code, strict=True):
            torch.testing.assert_close(part[0], whole[row], atol=1e-5, rtol=1e-4)
        made, seen = model.decode(alone.mean, one["cvar"], one["topology"])
        torch.testing.assert_close(made[0], offsets[row], atol=1e-6, rtol=1e-4)
        torch.testing.assert_close(seen[0], mask[row], atol=1e-5, rtol=1e-4)


def test_the_order_of_a_batch_of_both_topologies_does_not_matter(model, batch):
    order = np.random.default_rng(0).permutation(9).tolist()
    code, turned = model.encode(batch), model.encode(rows_of(batch, order))
    torch.testing.assert_close(turned.mean, code.mean[order], atol=1e-5, rtol=1e-4)
    there = model.decode(code.mean, batch["cvar"], batch["topology"])
    here = model.decode(code.mean[order], batch["cvar"][order], batch["topology"][order])
    for a, b in zip(here, there, strict=True):
        torch.testing.assert_close(a, b[order], atol=1e-5, rtol=1e-4)


def test_topologies_differ_in_graph_alone(model, batch):
    z = model.encode(batch).mean
    body = model.decode(z, batch["cvar"], torch.zeros(9, dtype=torch.long))[0]
    skirt = model.decode(z, batch["cvar"], torch.ones(9, dtype=torch.long))[0]
    assert not torch.allclose(body, skirt)


def test_decoding_needs_only_z_and_conditions(model, batch):
    """Given z, the output does not change with the garment that went in: nothing leaks past z."""
    inputs = batch["offsets"].clone().requires_grad_(True)
    parts = model.parts({**batch, "offsets": inputs})
    order = torch.cat([part.rows for part in parts.values()])
    z = model.encode_parts(parts).mean
    assert torch.autograd.grad(z.sum(), inputs)[0].abs().sum() > 0
    counts = {name: len(part.rows) for name, part in parts.items()}
    free = z.detach().requires_grad_(True)
    out = sum(x.sum() for x in model.decode_parts(free, batch["cvar"][order], counts).values())
    by_z, by_input = torch.autograd.grad(out, (free, inputs), allow_unused=True)
    assert by_z.abs().sum() > 0
    assert by_input is None


def test_without_a_mask_branch_there_are_offsets_only(batch):
    settings = replace(SETTINGS, training=replace(SETTINGS.training, mask=False))
    model = StaticVae(settings, toy_domain())
    z = model.encode(batch).mean
    offsets, mask = model.decode(z, batch["cvar"], batch["topology"])
    assert offsets.shape == (9, VERTICES, 3)
    assert mask is None


def test_same_seed_same_weights():
    first, again = (StaticVae(SETTINGS, toy_domain()).state_dict() for _ in range(2))
    other = StaticVae(
        replace(SETTINGS, training=replace(SETTINGS.training, seed=1)), toy_domain()
    ).state_dict()
    assert all(torch.equal(first[key], again[key]) for key in first)
    assert not torch.equal(
        first["network.encoder.features.weight"], other["network.encoder.features.weight"]
    )
