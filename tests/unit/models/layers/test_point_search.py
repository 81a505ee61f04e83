"""Indices against plain searches, on coordinates whose squared distances are exact in float32."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from drapeline.models.layers.point_search import (
    BallSearch,
    farthest_points,
    gather_rows,
    nearest_neighbours,
)


def clouds(*shape, step=64, seed=0):
    """Points (*shape, 3) on a coarse lattice: many ties, no rounding."""
    rng = torch.Generator().manual_seed(seed)
    return torch.randint(-step, step + 1, (*shape, 3), generator=rng) / step


def flags(*shape, share=0.7, seed=1):
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed)) < share


def squared(a, b):
    """(B, Q, P) squared distances from queries b to points a."""
    return ((b[:, :, None] - a[:, None]) ** 2).sum(-1)


def plain_farthest(points, count, valid):
    points, valid = points.double().numpy(), valid.numpy()
    chosen = []
    for cloud, mask in zip(points, valid, strict=True):
        ids = np.flatnonzero(mask)
        picks = [ids[0]]
        while len(picks) < count:
            away = ((cloud[ids, None] - cloud[picks]) ** 2).sum(-1).min(1)
            picks.append(ids[away.argmax()])
        chosen.append(picks)
    return np.array(chosen)


def plain_ball(points, centres, radius, count, valid):
    distance = squared(points, centres).masked_fill(~valid[:, None], torch.inf)
    answer = torch.zeros(*centres.shape[:2], count, dtype=torch.int64)
    for b, q in np.ndindex(*centres.shape[:2]):
        near = torch.nonzero(distance[b, q] <= radius**2)[:count, 0]
        if not len(near):
            near = distance[b, q].argmin()[None]
        answer[b, q] = near[0]
        answer[b, q, : len(near)] = near
    return answer


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_farthest_points_are_those_of_a_plain_search(share):
    points, valid = clouds(4, 200), flags(4, 200, share=share)
    chosen = farthest_points(points, 40, valid)
    np.testing.assert_array_equal(chosen.numpy(), plain_farthest(points, 40, valid))
    assert valid.gather(1, chosen).all()


def test_farthest_points_of_many_buckets_are_those_of_a_plain_search():
    points = torch.rand(1, 1500, 3, generator=torch.Generator().manual_seed(0))
    valid = flags(1, 1500)
    points[~valid] = torch.nan
    np.testing.assert_array_equal(
        farthest_points(points, 300, valid).numpy(), plain_farthest(points, 300, valid)
    )


def test_farthest_points_of_a_part_are_the_first_of_all():
    # Without ties: equal distances go to the lowest index, which a part may number differently.
    points = torch.rand(3, 300, 3, generator=torch.Generator().manual_seed(0))
    chosen = farthest_points(points, 64)
    again = farthest_points(gather_rows(points, chosen), 16)
    assert (again == torch.arange(16)).all()


def test_farthest_points_lie_apart_and_leave_no_gap():
    points = torch.rand(1, 500, 3, generator=torch.Generator().manual_seed(0))
    middle = gather_rows(points, farthest_points(points, 50))
    gap = squared(middle, points).amin(-1).max().sqrt()
    apart = torch.cdist(middle, middle)[0].fill_diagonal_(9).min()
    assert apart >= gap


def test_more_farthest_points_than_points_repeat_the_first():
    points = clouds(1, 5)
    chosen = farthest_points(points, 9, torch.tensor([[False, True, True, False, True]]))
    assert sorted(chosen[0, :3].tolist()) == [1, 2, 4]
    assert (chosen[0, 3:] == 1).all()


@pytest.mark.parametrize("share", [1.0, 0.5])
@pytest.mark.parametrize(
    ("radius", "count"), [(0.05, 4), (0.25, 8), (0.5, 16), (1.0, 4), (4.0, 300)]
)
def test_balls_are_those_of_a_plain_search(radius, count, share):
    points, centres = clouds(3, 250), clouds(3, 60, seed=2)
    valid = flags(3, 250, share=share)
    ours = BallSearch(points, radius, valid)(centres, count)
    assert torch.equal(ours, plain_ball(points, centres, radius, count, valid))


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("spread", [1, 8, 40])
def test_empty_balls_have_the_nearest_point_however_far_it_is(radius, spread):
    points, centres = clouds(2, 900), clouds(2, 60, seed=2) * spread
    points[:, :600] /= 8  # crowded in the middle, lonely around it
    points[0, 3] = torch.nan
    valid = flags(2, 900)
    ours = BallSearch(points, radius, valid)(centres, 6)
    points[0, 3] = 1e4
    assert torch.equal(ours, plain_ball(points, centres, radius, 6, valid))


def test_a_point_on_the_sphere_is_in_the_ball():
    points = torch.tensor([[[1.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]]])
    index = BallSearch(points, 0.5)(torch.zeros(1, 1, 3), 4)
    assert index.tolist() == [[[1, 2, 1, 1]]]
    many = points[:, 1:2].repeat(1, 100, 1)  # so many that cells are not looked into
    assert BallSearch(many, 0.5)(torch.zeros(1, 1, 3), 2).tolist() == [[[0, 1]]]


@pytest.mark.parametrize("k", [1, 3, 20])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_nearest_neighbours_are_those_of_a_plain_search(k, share):
    points, queries = clouds(3, 150), clouds(3, 70, seed=2)
    valid = flags(3, 150, share=share)
    distance = squared(points, queries).masked_fill(~valid[:, None], torch.inf)
    order = distance.argsort(dim=-1, stable=True)[..., :k]
    away, index = nearest_neighbours(points, queries, k, valid)
    assert torch.equal(index, order)
    assert torch.equal(away, distance.gather(-1, order))


def test_nearest_distances_are_those_of_a_tree():
    points = torch.rand(2, 800, 3, generator=torch.Generator().manual_seed(0))
    queries = torch.rand(2, 50, 3, generator=torch.Generator().manual_seed(1))
    away, _ = nearest_neighbours(points, queries, 64)
    for b in range(2):
        tree, _ = cKDTree(points[b].double()).query(queries[b].double(), 64)
        np.testing.assert_allclose(away[b].sqrt(), tree, atol=1e-6)


def test_fewer_points_than_wanted_neighbours_are_infinitely_far():
    valid = torch.tensor([[True, False, True]])
    away, index = nearest_neighbours(clouds(1, 3), clouds(1, 4, seed=1), 3, valid)
    assert torch.isinf(away[..., 2]).all()
    assert torch.isfinite(away[..., :2]).all()
    assert (index[..., 2] == 0).all()


def test_a_cloud_without_valid_points_is_survived():
    points, nothing = clouds(2, 9), flags(2, 9, share=0)
    assert farthest_points(points, 3, nothing).shape == (2, 3)
    assert BallSearch(points, 0.3, nothing)(points, 5).shape == (2, 9, 5)
    for k in (1, 2):
        away, _ = nearest_neighbours(points, points, k, nothing)
        assert torch.isinf(away).all()


def test_the_nearest_is_the_first_of_several_also_far_away_and_in_ties():
    points = torch.from_numpy(np.random.default_rng(1).integers(0, 4, (2, 60, 3))).float()
    queries = torch.cat([points[:, :20] + 0.5, 50 * points[:, 20:40] - 80], 1)
    valid = flags(2, 60)
    squared, index = nearest_neighbours(points, queries, 1, valid)
    both, indices = nearest_neighbours(points, queries, 2, valid)
    assert torch.equal(squared, both[..., :1])
    assert torch.equal(index, indices[..., :1])


def test_a_batch_is_its_clouds_one_by_one():
    points, centres, valid = clouds(3, 80), clouds(3, 20, seed=2), flags(3, 80)
    for b in range(3):
        one = points[b : b + 1], centres[b : b + 1], valid[b : b + 1]
        assert torch.equal(
            farthest_points(points, 9, valid)[b], farthest_points(one[0], 9, one[2])[0]
        )
        assert torch.equal(
            BallSearch(points, 0.3, valid)(centres, 5)[b],
            BallSearch(one[0], 0.3, one[2])(one[1], 5)[0],
        )


def test_points_need_be_neither_contiguous_nor_single_precision():
    points, centres = clouds(2, 60), clouds(2, 10, seed=2)
    turned = points.transpose(0, 1).contiguous().transpose(0, 1).double().requires_grad_(True)
    assert torch.equal(farthest_points(turned, 8), farthest_points(points, 8))
    assert torch.equal(BallSearch(turned, 0.4)(centres, 6), BallSearch(points, 0.4)(centres, 6))


def test_gathered_rows_are_those_of_the_same_cloud():
    rows = torch.arange(2 * 5 * 3.0).view(2, 5, 3)
    index = torch.tensor([[[4, 0], [1, 1]], [[2, 3], [0, 4]]])
    expected = torch.stack([rows[b][index[b]] for b in range(2)])
    assert torch.equal(gather_rows(rows, index), expected)
