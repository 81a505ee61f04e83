"""Layers against slow twins that follow the papers' formulas pair by pair."""

import pytest
import torch
from torch import nn

from drapeline.models.layers.point_search import BallSearch, farthest_points
from drapeline.models.layers.pointnet import (
    FeaturePropagation,
    Neighbourhoods,
    PointLevel,
    RunningNorm,
    SetAbstraction,
    interpolate,
    max_pool,
)

RADIUS, COUNT = 0.3, 6


pytestmark = pytest.mark.usefixtures("double")


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def toy_level(clouds=2, points=40, width=5, share=0.8):
    place = torch.rand(clouds, points, 3, generator=rng(1))
    valid = torch.rand(clouds, points, generator=rng(2)) < share
    features = torch.randn(clouds, points, width, generator=rng(3)) * valid[..., None]
    return PointLevel(place, features, valid)


def noisy(module):
    """Biases and norms away from their trivial initial values."""
    for index, parameter in enumerate(module.parameters()):
        with torch.no_grad():
            parameter.add_(torch.randn(parameter.shape, generator=rng(index)) * 0.1)
    return module


def plain_neighbourhoods(layer, level, centres):
    """The perceptron on every pair, its first layer not taken apart."""
    index = BallSearch(level.points, layer.radius, level.valid)(centres, layer.count)
    answer = []
    for b in range(len(centres)):
        rows = []
        for q in range(centres.shape[1]):
            near = index[b, q]
            away = (level.points[b, near] - centres[b, q]) / layer.radius
            row = torch.cat([away, level.features[b, near]], dim=1)
            for linear in [layer.first, *layer.others]:
                row = torch.relu(linear(row))
            rows.append(row.max(0).values)
        answer.append(torch.stack(rows))
    return torch.stack(answer)


@pytest.mark.parametrize("widths", [(4,), (4, 6), (8, 4, 7)])
@pytest.mark.parametrize("inputs", [0, 5])
def test_folded_first_layer_is_the_perceptron_on_every_pair(widths, inputs):
    layer = noisy(Neighbourhoods(inputs, widths, RADIUS, COUNT, rng()))
    level = toy_level(width=inputs)
    centres = torch.rand(2, 9, 3, generator=rng(4)).requires_grad_(True)
    places = level.points.requires_grad_(True)
    ours, plain = layer(level, centres), plain_neighbourhoods(layer, level, centres)
    torch.testing.assert_close(ours, plain)
    weigh = torch.randn(ours.shape, generator=rng(5))
    wanted = [centres, places, *layer.parameters()]
    mine = torch.autograd.grad((ours * weigh).sum(), wanted)
    theirs = torch.autograd.grad((plain * weigh).sum(), wanted)
    for a, b in zip(mine, theirs, strict=True):
        torch.testing.assert_close(a, b)


def test_a_neighbourhood_moves_with_its_points_but_not_with_the_cloud():
    layer = noisy(Neighbourhoods(5, (4, 6), RADIUS, COUNT, rng()))
    level, shift = toy_level(), torch.tensor([3.0, -1.0, 0.5])
    centres = torch.rand(2, 9, 3, generator=rng(4))
    moved = level._replace(points=level.points + shift)
    torch.testing.assert_close(layer(moved, centres + shift), layer(level, centres))
    assert not torch.allclose(layer(moved, centres), layer(level, centres))


def test_balls_that_are_not_full_do_not_depend_on_the_order_of_points():
    layer = noisy(Neighbourhoods(5, (4, 6), RADIUS, 40, rng()))
    level, centres = toy_level(), torch.rand(2, 9, 3, generator=rng(4))
    order = torch.randperm(40, generator=rng(5))
    mixed = PointLevel(*(part[:, order] for part in level))
    torch.testing.assert_close(layer(mixed, centres), layer(level, centres))


def test_padding_has_no_effect():
    layer = noisy(SetAbstraction(5, (0.2, 0.4), (4, 8), ((4, 6), (8,)), rng()))
    level = toy_level(share=1)
    chosen = farthest_points(level.points, 12)
    padded = PointLevel(
        torch.cat([level.points, level.points + 0.01], 1),
        torch.cat([level.features, level.features + 9], 1),
        torch.cat([level.valid, ~level.valid], 1),
    )
    for ours, plain in zip(layer(padded, chosen), layer(level, chosen), strict=True):
        torch.testing.assert_close(ours, plain)


def test_clouds_without_points_give_zero_and_no_gradient_that_is_not_finite():
    layer = noisy(SetAbstraction(5, (0.2, 0.4), (4, 8), ((4, 6), (8,)), rng()))
    back = noisy(FeaturePropagation(14, 5, (7, 4), rng()))
    level = toy_level()
    level.valid[0] = False
    level.features[0] = 0
    coarse = layer(level, farthest_points(level.points, 12, level.valid))
    assert not coarse.valid[0].any()
    assert (coarse.features[0] == 0).all()
    assert (coarse.features[1] != 0).any()
    (back(level, coarse).square().sum() + max_pool(coarse.features, coarse.valid).sum()).backward()
    for parameter in [*layer.parameters(), *back.parameters()]:
        assert torch.isfinite(parameter.grad).all()


def test_a_batch_is_its_clouds_one_by_one():
    down = noisy(SetAbstraction(5, (0.2, 0.4), (4, 8), ((4, 6), (8,)), rng()))
    up = noisy(FeaturePropagation(14, 5, (7, 4), rng()))
    level = toy_level(clouds=3)
    chosen = farthest_points(level.points, 12, level.valid)
    whole = up(level, down(level, chosen))
    for b in range(3):
        one = PointLevel(*(part[b : b + 1] for part in level))
        torch.testing.assert_close(up(one, down(one, chosen[b : b + 1]))[0], whole[b])


def test_propagation_interpolates_and_then_applies_its_layers():
    layer = noisy(FeaturePropagation(6, 5, (7, 4), rng()))
    fine, coarse = toy_level(), toy_level(points=11, width=6, share=1)
    distance = (fine.points[:, :, None] - coarse.points[:, None]).square().sum(-1)
    near, index = distance.topk(3, largest=False)
    share = 1 / (near + 1e-8)
    share = share / share.sum(-1, keepdim=True)
    picked = torch.stack([coarse.features[b][index[b]] for b in range(2)])
    joined = torch.cat([(picked * share[..., None]).sum(2), fine.features], -1)
    plain = layer.others(nn.functional.relu(layer.norm(layer.first(joined))))
    torch.testing.assert_close(layer(fine, coarse), plain, rtol=1e-5, atol=1e-6)


def test_interpolation_gives_points_their_own_features_and_keeps_constants():
    level = toy_level(points=11, share=1)
    own = interpolate(level, level.points)
    torch.testing.assert_close(own, level.features, rtol=1e-3, atol=1e-3)
    level = level._replace(features=torch.full_like(level.features, 2.5))
    constant = interpolate(level, torch.rand(2, 30, 3, generator=rng(6)))
    torch.testing.assert_close(constant, torch.full_like(constant, 2.5))


def test_pooling_takes_the_largest_of_the_valid():
    features = torch.tensor([[[1.0, -5], [3, -7], [9, 9]], [[1, 2], [3, 4], [5, 6]]])
    valid = torch.tensor([[True, True, False], [False, False, False]])
    assert max_pool(features, valid).tolist() == [[3, -5], [0, 0]]


def test_every_parameter_gets_a_gradient():
    down = SetAbstraction(5, (0.2, 0.4), (4, 8), ((8, 6), (8,)), rng())
    up = FeaturePropagation(14, 5, (8, 6), rng())
    level = toy_level()
    rows = up(level, down(level, farthest_points(level.points, 12, level.valid)))
    (rows * torch.randn(rows.shape, generator=rng(7))).sum().backward()
    for name, parameter in [*down.named_parameters(), *up.named_parameters()]:
        assert parameter.grad.abs().sum() > 0, name


def test_only_training_with_gradients_adds_to_what_was_seen():
    norm = RunningNorm(3)
    x = 5 + 2 * torch.randn(64, 3, generator=rng(1))
    with torch.no_grad():
        torch.testing.assert_close(norm(x), x, rtol=1e-3, atol=1e-3)
    for _ in range(50):
        norm(x)
    seen = norm.eval()(x)
    assert seen.mean().abs() < 0.05
    assert (seen.std(0) - 1).abs().max() < 0.1
    torch.testing.assert_close(norm(x[:1]), seen[:1])
