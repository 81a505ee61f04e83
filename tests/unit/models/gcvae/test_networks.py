"""What the networks must not depend on, and what they need."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.networks import GcvaeNetwork
from drapeline.models.gcvae.settings import GcvaeTraining, VaeSettings
from drapeline.models.gcvae.vae import StaticVae
from gcvae_toys import VERTICES, ToyGarments, toy_domain

NETWORK = GcvaeNetwork(widths=(6, 8, 8, 10), features=12, latent=5, condition=4)
SETTINGS = VaeSettings(network=NETWORK, training=GcvaeTraining(normal_parts=2))


def as_tensors(batch):
    return {k: torch.from_numpy(v) if isinstance(v, np.ndarray) else v for k, v in batch.items()}


def rows_of(batch, rows):
    return {
        key: [value[i] for i in rows] if isinstance(value, list) else value[torch.tensor(rows)]
        for key, value in batch.items()
    }


def drawn_model(settings):
    """An untrained model, with a last layer that is not zero."""
    model = StaticVae(settings, toy_domain()).eval()
    model.prepare(ToyGarments())
    weight = model.network.decoder.branches.weight
    torch.nn.init.normal_(weight, std=0.3, generator=torch.Generator().manual_seed(0))
    return model


@pytest.fixture(scope="module")
def model():
    return drawn_model(SETTINGS)


@pytest.fixture(scope="module")
def batch():
    batch = as_tensors(ToyGarments().batch(np.arange(9)))
    assert 0 < batch["topology"].sum() < 9
    return batch


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


def test_the_first_and_last_layers_keep_their_width_when_the_rest_doubles():
    double = replace(NETWORK, scale=2)
    assert double.level_widths == [6, 16, 16, 20]
    model = StaticVae(replace(SETTINGS, network=double), toy_domain())
    assert model.network.encoder.levels[0].first.weight.shape == (2, 6, 6)
    assert model.network.decoder.branches.weight.shape == (VERTICES, 6, 4)


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


def test_a_level_is_a_convolution_that_knows_its_place_beside_a_skip_connection(model):
    """Against ReLU(h + conv(h)) with h = ReLU(conv(x) + places)."""
    level, graph = model.network.encoder.levels[0], model.network.graphs["body"]
    x = torch.randn(VERTICES, 2, 6, generator=torch.Generator().manual_seed(1))
    laplacian, places = graph.laplacians[0], graph.places(0)
    with torch.no_grad():
        hidden = torch.relu(level.first(x, laplacian) + level.places(places)[:, None])
        expected = torch.relu(level.second(hidden, laplacian) + hidden)
        torch.testing.assert_close(level(x, laplacian, laplacian, places), expected)
        blind = level(x, laplacian, laplacian, torch.zeros_like(places))
    assert not torch.allclose(blind, expected)


def test_places_are_positions_and_normals_of_the_mean_body_and_means_further_up(model):
    graph, body = model.network.graphs["skirt"], toy_domain().body_mean
    position = (body - body.mean(0)) / (body - body.mean(0)).std()
    np.testing.assert_allclose(graph.places(0)[:, :3], position, atol=1e-6)
    np.testing.assert_allclose(graph.places(0)[:, 3:].norm(dim=1), 1, atol=1e-5)
    for level, parents in enumerate(toy_domain().parents["skirt"]):
        fine, coarse = graph.places(level).numpy(), graph.places(level + 1).numpy()
        for node in range(len(coarse)):
            np.testing.assert_allclose(coarse[node], fine[parents == node].mean(0), atol=1e-5)


def test_what_all_garments_share_is_taken_off_their_pooled_features(model):
    seen = []
    hook = model.network.encoder.features.register_forward_pre_hook(lambda _, x: seen.append(x[0]))
    try:
        model.encode(as_tensors(ToyGarments().batch(ToyGarments().rows("train"))))
    finally:
        hook.remove()
    (rows,) = seen
    assert rows.mean(0).abs().max() < 1e-3
    assert rows.std(0).max() == pytest.approx(1, abs=1e-3)


def test_codes_begin_near_the_prior_s_mean_with_small_variance(model, batch):
    code = model.encode(batch)
    assert code.mean.abs().mean() < 3
    assert (code.log_variance + 4).abs().max() < 2
