"""What the networks must not depend on, and what they need."""

import pytest
import torch

from drapeline.models.gcvae.vae import StaticVae
from toys.gcvae import VERTICES, toy_template
from toys.gcvae_files import SETTINGS


@pytest.fixture
def model(untrained):
    return untrained


def test_the_first_and_last_layers_keep_their_width_when_the_rest_doubles():
    double = SETTINGS.network.replace(scale=2)
    assert double.level_widths == [6, 16, 16, 20]
    model = StaticVae(SETTINGS.replace(network=double), toy_template())
    assert model.network.encoder.levels[0].first.weight.shape == (2, 7, 6)
    assert model.network.decoder.branches.weight.shape == (VERTICES, 6, 4)


def test_a_level_is_a_convolution_beside_a_skip_connection(model):
    """ReLU(h + conv(h)) with h = ReLU(conv(x))."""
    level, graph = model.network.encoder.levels[0], model.network.graphs["body"]
    x = torch.randn(VERTICES, 2, 7, generator=torch.Generator().manual_seed(1))
    laplacian = graph.laplacians[0]
    with torch.no_grad():
        hidden = torch.relu(level.first(x, laplacian))
        expected = torch.relu(level.second(hidden, laplacian) + hidden)
        torch.testing.assert_close(level(x, laplacian, laplacian), expected)


def test_codes_begin_near_the_prior(model, batch):
    code = model.encode(batch)
    assert code.mean.abs().mean() < 3
    assert code.log_variance.abs().max() < 2


def without(**network):
    """A network that lacks something, as it is before its first step."""
    return StaticVae(SETTINGS.replace(network=network), toy_template())


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


def test_a_shared_output_layer_has_one_set_of_weights():
    assert without(vertex_output=False).network.decoder.branches.weight.shape == (2, 6, 4)


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
