import pytest
import torch
from torch.nn.utils.parametrizations import weight_norm

from drapeline.models.smplicit.decoder import FieldDecoder, WeightNormLinear

CLUSTERS, CUT, STYLE = 7, 2, 3


@pytest.fixture(scope="module")
def decoder():
    rng = torch.Generator().manual_seed(0)
    return FieldDecoder(CLUSTERS, CUT, STYLE, width=0.1, rng=rng).double()


@pytest.fixture(scope="module")
def given():
    rng = torch.Generator().manual_seed(1)

    def draw(*shape):
        return torch.randn(*shape, generator=rng, dtype=torch.float64)

    return draw(2, 5, 3), draw(2, CLUSTERS, 3), draw(2, CUT), draw(2, STYLE)


def plain(decoder, points, places, z_cut, z_style):
    """Layer after layer on the offsets to all clusters, as the paper has it."""
    count = points.shape[1]
    offsets = (points[:, :, None] - places[:, None]).flatten(2)
    query = torch.relu(decoder.fc1_query(torch.relu(decoder.fc0_query(offsets))))
    style = torch.relu(decoder.fc1_cloth(torch.relu(decoder.fc0_cloth(z_style))))
    x = torch.cat(
        [style[:, None].expand(-1, count, -1), query, z_cut[:, None].expand(-1, count, -1)], 2
    )
    for index in range(4):
        x = torch.relu(getattr(decoder, f"fc{index}")(x))
    return decoder.fc4(x)[..., 0]


def test_folded_layers_give_the_numbers_of_plain_ones(decoder, given):
    torch.testing.assert_close(decoder(*given), plain(decoder, *given), rtol=0, atol=1e-12)


def test_slopes_of_the_base_are_its_derivatives(decoder, given):
    _, _, z_cut, z_style = given
    by_cut, by_style = torch.autograd.functional.jacobian(decoder.base, (z_cut, z_style))
    slopes = decoder.base_slopes(z_style)
    for index in range(2):
        expected = torch.cat([by_cut[index, :, index], by_style[index, :, index]], 1)
        torch.testing.assert_close(slopes[index], expected)


def test_layers_of_a_garment_give_the_same(decoder, given):
    points, *codes = given
    expected = decoder(*given)
    for index in range(2):
        one = [value[index : index + 1] for value in codes]
        x = points[index]
        layers = decoder.layers(decoder.condition(*one))
        for weight, bias in layers[:-1]:
            x = torch.relu(x @ weight + bias)
        weight, bias = layers[-1]
        torch.testing.assert_close((x @ weight + bias)[:, 0], expected[index], rtol=0, atol=1e-12)


def test_only_offsets_from_the_body_count(decoder, given):
    points, places, *codes = given
    shift = torch.tensor([0.3, -2.0, 1.0], dtype=torch.float64)
    moved = decoder(points + shift, places + shift, *codes)
    torch.testing.assert_close(moved, decoder(*given), rtol=0, atol=1e-12)
    assert not torch.allclose(decoder(points + shift, places, *codes), moved)


def test_garments_and_points_do_not_depend_on_one_another(decoder, given):
    points, *others = given
    whole = decoder(*given)
    part = decoder(points[1:, 2:4], *(value[1:] for value in others))
    torch.testing.assert_close(part, whole[1:, 2:4], rtol=0, atol=1e-12)


def test_both_codes_matter(decoder, given):
    points, places, z_cut, z_style = given
    assert not torch.allclose(decoder(points, places, z_cut + 1, z_style), decoder(*given))
    assert not torch.allclose(decoder(points, places, z_cut, z_style + 1), decoder(*given))


def test_weights_are_normalised_as_torch_does_it():
    own = WeightNormLinear(4, 3, torch.Generator().manual_seed(3))
    other = torch.nn.Linear(4, 3)
    with torch.no_grad():
        other.weight.copy_(own.weight)
        other.bias.copy_(own.bias)
    other = weight_norm(other)
    with torch.no_grad():
        own.weight_v.mul_(5.0)  # the length of v is immaterial
        own.weight_g[1] = 2.0
        other.parametrizations.weight.original0[1] = 2.0
    x = torch.randn(6, 4, generator=torch.Generator().manual_seed(4))
    torch.testing.assert_close(own(x), other(x))


def test_weights_come_from_the_generator_alone():
    one, same = (
        FieldDecoder(3, 2, 2, width=0.1, rng=torch.Generator().manual_seed(5)) for _ in range(2)
    )
    for a, b in zip(one.parameters(), same.parameters(), strict=True):
        assert torch.equal(a, b)
