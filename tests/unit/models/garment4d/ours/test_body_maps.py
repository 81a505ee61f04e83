"""Maps of the body, and the regression on them."""

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d.ours import body_maps
from drapeline.models.garment4d.ours.body_maps import (
    SHAPE_CELL_M,
    MapRegression,
    body_map,
    garment_maps,
    map_cells,
)
from drapeline.seeding import rng_for

SEQUENCES = ["a", "a", "a", "b", "c", "c", "d", "e", "e", "f", "g", "h"]


def draw(seed):
    return torch.Generator().manual_seed(seed)


def test_a_map_of_the_body_is_the_mean_over_cells_of_both_halves():
    place = torch.rand(6, 40, 4, generator=draw(7)) * torch.tensor([2.4, 1.0, 1.8, 1.0]) - 1.2
    values = torch.rand(6, 40, 2, generator=draw(8))
    found = body_map(place, values, 3, 0.05)
    cells: dict[tuple[int, int, int], list[list[float]]] = {}
    for cloud in range(6):
        for (x, _, z, _), value in zip(place[cloud].tolist(), values[cloud].tolist(), strict=True):
            column = min(int(abs(x) / 0.05), 18)
            row = min(max(int((z + 1.1) // 0.05), 0), 31)
            cells.setdefault((cloud // 3, column, row), []).append(value)
    expected = torch.zeros(2, 2, 19, 32)
    for (window, column, row), within in cells.items():
        expected[window, :, column, row] = torch.tensor(within).mean(0)
    torch.testing.assert_close(found, expected.flatten(1))
    assert expected[0, 0].numel() == map_cells(0.05)


def test_garment_maps_show_share_depth_and_height_where_points_are():
    # Two points at the left and the right of one cell, one above all cells, one alone in its cell.
    place = torch.tensor(
        [[0.26, -0.1, -0.49, 2.0], [-0.27, 0.3, -0.48, 1.0], [0.0, 0.2, 9.0, 0.5], [0.9, 0, 0.2, 3]]
    )
    chosen = torch.tensor([[[True, False, True, False]]])
    (found,) = garment_maps(place[None, None], chosen)
    cells = [10 * 64 + 24, 0 * 64 + 63, 36 * 64 + 52]
    expected = torch.tensor([[0.5, 1, 0], [0.2, 0.2, 0], [1.5, 0.5, 3]])
    torch.testing.assert_close(found[:, cells], expected)
    rest = torch.ones(found.shape[1], dtype=torch.bool)
    rest[cells] = False
    assert (found[0, rest] == 0).all()
    assert found[1:, rest].isnan().all()


def test_garment_maps_are_those_of_single_windows_of_all_frames_in_any_order():
    place = torch.rand(2, 3, 40, 4, generator=draw(5)) - 0.5
    chosen = torch.rand(2, 3, 40, generator=draw(6)) < 0.5
    found = garment_maps(place, chosen)
    assert found.shape == (2, 3, map_cells(SHAPE_CELL_M))
    for window in range(2):
        # The same points as those of one frame.
        whole = (each[window].flatten(0, 1)[None, None] for each in (place, chosen))
        torch.testing.assert_close(garment_maps(*whole)[0], found[window], equal_nan=True)
    order = torch.randperm(40, generator=draw(7))
    mixed = garment_maps(place[:, [1, 2, 0]][:, :, order], chosen[:, [1, 2, 0]][:, :, order])
    torch.testing.assert_close(mixed, found, equal_nan=True)


@pytest.fixture
def given():
    """Maps (12, 2, 15), more values than windows, and coefficients (12, 3) that they tell about.

    Some cells of the second kind are not known.
    """
    rng = rng_for(0, "maps")
    maps = rng.normal(size=(len(SEQUENCES), 2, 15)) * [[[1.0], [0.1]]] + 2
    maps[:, 0] *= np.geomspace(0.01, 1, 15)
    flat = maps.reshape(len(maps), -1)
    coefficients = flat @ rng.normal(size=(30, 3)) + rng.normal(size=(len(SEQUENCES), 3))
    maps[rng.random(maps.shape) < [[[0.0], [0.3]]]] = np.nan
    return maps.astype(np.float32), coefficients.astype(np.float32)


def fitted(maps, coefficients, sequences=SEQUENCES, metric=None):
    regression = MapRegression(*maps.shape[1:], coefficients.shape[1])
    metric = np.eye(coefficients.shape[1]) if metric is None else metric
    return regression, *regression.fit(maps, coefficients, sequences, metric)


def shares(sequences):
    return np.array([1 / sequences.count(one) for one in sequences])


def seen(maps):
    """Maps as the regression sees them, cell by cell."""
    weights, columns = shares(SEQUENCES), []
    for kind in np.moveaxis(maps.astype(np.float64), 1, 0):
        gaps, deviations = [], []
        for cell in kind.T:
            known = ~np.isnan(cell)
            gap = np.zeros(len(cell))
            gap[known] = cell[known] - np.average(cell[known], weights=weights[known])
            gaps.append(gap)
            deviations.append(np.sqrt(np.average(gap**2, weights=weights)))
        typical = np.median(deviations)
        columns += [g / np.hypot(d, 0.3 * typical) for g, d in zip(gaps, deviations, strict=True)]
    return np.stack(columns, axis=1) / np.sqrt(len(columns))


def slowly(rows, coefficients, sequences, ridge):
    """Weighed ridge regression with its mean, by normal equations: a function of rows."""
    weights = shares(sequences)
    mean = np.average(rows, axis=0, weights=weights)
    middle = np.average(coefficients, axis=0, weights=weights)
    gap = rows - mean
    system = gap.T @ (weights[:, None] * gap) + ridge * np.eye(rows.shape[1])
    slope = np.linalg.solve(system, gap.T @ (weights[:, None] * (coefficients - middle)))
    return lambda new: (new - mean) @ slope + middle


@pytest.mark.parametrize("ridge", [0.01, 1.0])
def test_what_is_left_out_is_what_fits_without_it_say(given, monkeypatch, ridge):
    monkeypatch.setattr(body_maps, "_RIDGES", np.array([ridge]))
    regression, found, error = fitted(*given)
    rows, coefficients = seen(given[0]), given[1].astype(np.float64)
    whole = slowly(rows, coefficients, SEQUENCES, ridge)
    said = regression(torch.from_numpy(given[0])).numpy()
    np.testing.assert_allclose(said, whole(rows), atol=2e-4)
    squared = []
    for one in set(SEQUENCES):
        inside = np.array(SEQUENCES) == one
        rest = [name for name in SEQUENCES if name != one]
        without = slowly(rows[~inside], coefficients[~inside], rest, ridge)
        np.testing.assert_allclose(found[inside], without(rows[inside]), atol=2e-4)
        squared.append(((found[inside] - coefficients[inside]) ** 2).sum(1).mean())
    assert error == pytest.approx(np.mean(squared) ** 0.5, rel=1e-4)


def test_the_ridge_is_the_best_for_what_is_left_out_in_the_metric(given, monkeypatch):
    metric = np.diag([1.0, 4.0, 0.0])
    _, _, best = fitted(*given, metric=metric)
    each = []
    for ridge in body_maps._RIDGES:
        with monkeypatch.context() as only:
            only.setattr(body_maps, "_RIDGES", np.array([ridge]))
            _, found, error = fitted(*given, metric=metric)
        off = found - given[1]
        mean = np.average(((off @ metric) * off).sum(1), weights=shares(SEQUENCES))
        assert error == pytest.approx(mean**0.5, rel=1e-4)
        each.append(error)
    assert best == pytest.approx(min(each))
    assert min(each) < 0.99 * max(each)


def test_a_linear_truth_is_found():
    rng = rng_for(0, "linear maps")
    maps = rng.uniform(-1, 1, size=(300, 2, 3)).astype(np.float32)
    slope = rng.normal(size=(6, 2))
    coefficients = (maps.reshape(300, 6) @ slope + 3).astype(np.float32)
    regression, found, error = fitted(maps, coefficients, [str(one) for one in range(300)])
    new = rng.uniform(-0.9, 0.9, size=(20, 2, 3)).astype(np.float32)
    said = regression(torch.from_numpy(new)).numpy()
    np.testing.assert_allclose(said, new.reshape(20, 6) @ slope + 3, atol=0.01)
    assert error < 0.01
    np.testing.assert_allclose(found, coefficients, atol=0.02)


def test_what_is_not_known_counts_as_the_mean_and_extremes_as_the_most_extreme_seen(given):
    regression, _, _ = fitted(*given)
    maps = torch.from_numpy(given[0])
    mean = regression.mean.expand_as(maps)
    torch.testing.assert_close(regression(torch.full_like(maps, torch.nan)), regression(mean))
    high, low = (torch.from_numpy(f(given[0], axis=0)) for f in (np.nanmax, np.nanmin))
    beyond = torch.where(torch.arange(15) % 2 == 0, high + 9, low - 9)
    edge = torch.where(torch.arange(15) % 2 == 0, high, low)
    torch.testing.assert_close(regression(beyond[None]), regression(edge[None]))
    assert (regression(edge[None]) - regression(mean[:1])).abs().max() > 0.1


def test_cells_that_never_change_have_no_say(given):
    maps, coefficients = given
    still = np.concatenate([maps, np.full((len(maps), 2, 5), 7, np.float32)], axis=2)
    still[:, 1, -1] = np.nan
    regression, found, _ = fitted(still, coefficients)
    alone, expected, _ = fitted(maps, coefficients)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    other = torch.from_numpy(still.copy())
    other[..., 15:] = -50
    torch.testing.assert_close(regression(other), alone(torch.from_numpy(maps)))


def test_nothing_is_said_before_the_fit():
    said = MapRegression(2, 4, 3)(torch.ones(5, 2, 4))
    torch.testing.assert_close(said, torch.zeros(5, 3))


def test_one_sequence_cannot_be_left_out(given):
    with pytest.raises(InputError, match="1 training sequence, expected two or more"):
        fitted(*given, sequences=["a"] * len(SEQUENCES))
