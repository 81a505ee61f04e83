"""Initial weights, skinning, and functions that leave mixed precision."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from drapeline.models.layers.linear import full_precision, he_uniform, linear, linear_blend_skinning


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


@full_precision
def product(a, b, scale=1):
    return scale * (a @ b)


def test_sixteen_bits_are_widened_within_autocast():
    a = torch.full((2, 2), 1.0 / 3)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert (a @ a).dtype == torch.bfloat16
        found = product(a.bfloat16(), a)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, a.bfloat16().float() @ a)


def test_places_metres_away_keep_their_millimetres():
    place = torch.tensor([[1.0 + 0.001, 0.0]])
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert float(product(place, torch.eye(2))[0, 0]) == float(place[0, 0])
        assert float((place @ torch.eye(2))[0, 0]) == 1.0


def test_without_autocast_nothing_is_changed():
    a = torch.eye(2, dtype=torch.bfloat16)
    assert product(a, a).dtype == torch.bfloat16
    assert product(a.double(), a.double()).dtype == torch.float64


def motions(*size, seed=0):
    """(*size, 24, 4, 4) rigid motions."""
    rng = np.random.default_rng(seed)
    out = np.tile(np.eye(4), (*size, 24, 1, 1))
    count = int(np.prod(size)) * 24
    turn = Rotation.from_rotvec(rng.normal(size=(count, 3))).as_matrix()
    out[..., :3, :3] = turn.reshape(*size, 24, 3, 3)
    out[..., :3, 3] = rng.normal(size=(*size, 24, 3))
    return torch.from_numpy(out)


def shares(*size, seed=0):
    rng = torch.Generator().manual_seed(seed)
    weights = torch.rand(*size, 24, generator=rng, dtype=torch.float64) ** 4
    return weights / weights.sum(-1, keepdim=True)


def points(*size):
    rng = torch.Generator().manual_seed(1)
    return torch.randn(*size, 3, generator=rng, dtype=torch.float64)


def test_skinning_is_the_weighted_sum_of_rigid_motions():
    canonical, weights, transforms = points(2, 9), shares(2, 9), motions(2, 4)
    ones = torch.cat([canonical, torch.ones(2, 9, 1, dtype=torch.float64)], -1)
    wanted = torch.zeros(2, 4, 9, 3, dtype=torch.float64)
    for joint in range(24):
        moved = torch.einsum("btij,bnj->btni", transforms[:, :, joint], ones)[..., :3]
        wanted += weights[:, None, :, joint, None] * moved
    made = linear_blend_skinning(canonical, weights, transforms)
    torch.testing.assert_close(made, wanted)
    torch.testing.assert_close(
        linear_blend_skinning(canonical, weights, transforms[..., :3, :]), made
    )
    every = canonical[:, None].expand(-1, 4, -1, -1)
    torch.testing.assert_close(linear_blend_skinning(every, weights, transforms), made)


def test_a_garment_per_frame_is_moved_by_its_own_frame():
    garments, weights, transforms = points(2, 4, 9), shares(2, 9), motions(2, 4)
    made = linear_blend_skinning(garments, weights, transforms)
    for frame in range(4):
        alone = linear_blend_skinning(garments[:, frame], weights, transforms[:, frame, None])
        torch.testing.assert_close(made[:, frame, None], alone)


def test_rest_stays_and_a_common_motion_is_rigid():
    canonical, weights = points(1, 9), shares(1, 9)
    rest = torch.eye(4, dtype=torch.float64).expand(1, 1, 24, 4, 4)
    torch.testing.assert_close(linear_blend_skinning(canonical, weights, rest)[:, 0], canonical)
    one = motions(1, 1)[:, :, :1].expand(-1, -1, 24, -1, -1)
    moved = linear_blend_skinning(canonical, weights, one)[0, 0]
    torch.testing.assert_close(torch.cdist(moved, moved), torch.cdist(canonical[0], canonical[0]))


@pytest.mark.parametrize("which", [0, 1, 2])
def test_gradients_by_finite_differences(which):
    arguments = [points(1, 3), shares(1, 3), motions(1, 2)]
    arguments[which].requires_grad_()
    assert torch.autograd.gradcheck(linear_blend_skinning, arguments, fast_mode=True)
