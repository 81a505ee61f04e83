"""What the networks must not depend on, and what they need."""

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.training.batches import as_tensors
from toys.gcvae import VERTICES, ToyGarments, toy_template
from toys.gcvae_files import SETTINGS


@pytest.fixture
def model(prepared_model):
    return prepared_model


def test_the_first_and_last_layers_keep_their_width_when_the_rest_doubles():
    double = SETTINGS.network.replace(scale=2)
    assert double.level_widths == [6, 16, 16, 20]
    model = StaticVae(SETTINGS.replace(network=double), toy_template())
    assert model.network.encoder.levels[0].first.weight.shape == (2, 7, 6)
    assert model.network.decoder.branches.weight.shape == (VERTICES, 6, 4)


def test_a_level_is_a_convolution_that_knows_its_place_beside_a_skip_connection(model):
    """Against ReLU(h + conv(h)) with h = ReLU(conv(x) + places)."""
    level, graph = model.network.encoder.levels[0], model.network.graphs["body"]
    x = torch.randn(VERTICES, 2, 7, generator=torch.Generator().manual_seed(1))
    laplacian, places = graph.laplacians[0], graph.places(0)
    with torch.no_grad():
        hidden = torch.relu(level.first(x, laplacian) + level.places(places)[:, None])
        expected = torch.relu(level.second(hidden, laplacian) + hidden)
        torch.testing.assert_close(level(x, laplacian, laplacian, places), expected)
        blind = level(x, laplacian, laplacian, torch.zeros_like(places))
    assert not torch.allclose(blind, expected)


def test_places_are_positions_and_normals_of_the_mean_body_and_means_further_up(model):
    graph, body = model.network.graphs["skirt"], toy_template().body_mean
    position = (body - body.mean(0)) / (body - body.mean(0)).std()
    np.testing.assert_allclose(graph.places(0)[:, :3], position, atol=1e-6)
    np.testing.assert_allclose(graph.places(0)[:, 3:].norm(dim=1), 1, atol=1e-5)
    for level, parents in enumerate(toy_template().parents["skirt"]):
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


def without(**network):
    """A network that lacks something, as it is before its first step."""
    model = StaticVae(SETTINGS.replace(network=network), toy_template())
    model.prepare(ToyGarments())
    return model


@pytest.mark.parametrize("masked", [True, False])
def test_what_offsets_are_where_there_is_no_garment_is_seen_if_the_input_is_not_masked(
    batch, masked
):
    model = without(masked_input=masked)
    elsewhere = {**batch, "offsets": batch["offsets"] + 0.01 * ~batch["mask"][..., None]}
    same = torch.equal(model.encode(batch).mean, model.encode(elsewhere).mean)
    assert same == masked


def test_a_masked_input_says_where_the_garment_ends(batch):
    """Of two garments that lie on their mean, the mask alone tells one from the other."""
    model = without()
    mean = model.offset_mean[batch["topology"]]
    shorter = batch["mask"] & (torch.arange(VERTICES) % 2 == 0)
    codes = [
        model.encode({**batch, "offsets": mean, "mask": mask}).mean
        for mask in (batch["mask"], shorter)
    ]
    assert not torch.allclose(*codes)


def test_without_places_a_level_does_not_look_at_them():
    model = without(places=False)
    graph = model.network.graphs["body"]
    x = torch.ones(VERTICES, 1, 7)
    level = model.network.encoder.levels[0]
    with torch.no_grad():
        blind = level(x, graph.laplacians[0], graph.laplacians[0], graph.places(0))
        other = level(x, graph.laplacians[0], graph.laplacians[0], 5 * graph.places(0))
    torch.testing.assert_close(blind, other)


def test_a_shared_output_layer_has_one_set_of_weights():
    assert without(vertex_output=False).network.decoder.branches.weight.shape == (2, 6, 4)


def test_pooled_features_are_as_they_come_unless_they_are_standardised():
    encoder = without(standardise=False).network.encoder
    assert (encoder.mean == 0).all()
    assert (encoder.std == 1).all()


def test_the_variance_that_codes_begin_with_is_a_setting(batch):
    code = without(log_variance=0.0).encode(batch)
    assert code.log_variance.abs().max() < 2


def test_a_network_that_has_learned_nothing_but_its_linear_path_is_that_path(batch):
    """The last layer is zero at first, so the rest of the decoder adds nothing to it."""
    model = without()
    decoder = model.network.decoder
    with torch.no_grad():
        decoder.linear_path.weight.normal_(generator=torch.Generator().manual_seed(5))
        z = model.encode(batch).mean
        parts = model.parts(batch)
        order = torch.cat([part.rows for part in parts.values()])
        counts = {name: len(part.rows) for name, part in parts.items()}
        made = model.decode_parts(z[order], batch["cvar"][order], counts)
        code = torch.cat([z, model.conditioning(batch["cvar"])], 1)
        wanted = decoder.linear_path(code).view(len(z), VERTICES, 4)
    for name, part in parts.items():
        torch.testing.assert_close(made[name].permute(2, 0, 1), wanted[part.rows])


def test_the_linear_path_learns_in_smaller_steps_and_every_weight_is_learned_once():
    model = without()
    others, straight = model.optimizer().param_groups
    assert others["rate_share"] > straight["rate_share"]
    found = [*others["params"], *straight["params"]]
    learned = {name for name, p in model.named_parameters() if p.requires_grad}
    names = {id(p): name for name, p in model.named_parameters()}
    assert sorted(names[id(p)] for p in found) == sorted(learned)
    assert {names[id(p)].split(".")[-2] for p in straight["params"]} == {"linear_path"}
    assert len(without(linear_path=False).optimizer().param_groups) == 1
