"""Predictions without a network, and their metrics."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics import baselines
from drapeline.metrics.baselines import (
    MEAN,
    STILL,
    fit_mean_garment,
    fit_pca,
    mean_wrinkles,
    moving_baseline_summary,
    nearest_rows,
    static_baselines,
)
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from toys.metric_rows import find_value
from toys.moving import moving_garment

ROWS, VERTICES = 40, 30
WRINKLE_M = 0.01


@pytest.fixture
def data():
    """Two garment types on 30 vertices: offsets of rank 3 within each row's mask."""
    rng = rng_for(0, "baselines")
    garment = np.arange(ROWS) % 2
    mask = np.where(garment[:, None] == 0, np.arange(VERTICES) < 20, np.arange(VERTICES) >= 10)
    directions = rng.normal(size=(3, VERTICES, 3))
    offsets = np.einsum("nk,kvi->nvi", rng.normal(size=(ROWS, 3)), directions)
    offsets = (offsets * mask[..., None]).astype(np.float32)
    cvar = rng.normal(size=(ROWS, 13)).astype(np.float32)
    return offsets, mask, garment, cvar, np.arange(30)


def test_mean_garment_averages_each_vertex_over_the_garments_that_cover_it(data):
    offsets, mask, garment, _, train = data
    mask, offsets = mask.copy(), offsets.copy()
    mask[0, 5], offsets[0, 5] = False, 0  # one garment has a hole there
    mean = fit_mean_garment(offsets, mask, garment, train, types=3)
    of_type = train[garment[train] == 0]
    np.testing.assert_allclose(mean.offsets[0, 5], offsets[of_type[1:], 5].mean(0), atol=1e-6)
    np.testing.assert_allclose(mean.offsets[0, 6], offsets[of_type, 6].mean(0), atol=1e-6)
    assert mean.mask[0].tolist() == [True] * 20 + [False] * 10
    assert not mean.mask[2].any()  # no garment of the third type


def test_nearest_row_is_of_the_same_type_and_of_the_training_set(data):
    _, _, garment, cvar, train = data
    cvar = cvar.copy()
    cvar[35] = cvar[3] + 1e-3
    cvar[36] = cvar[3] + 1e-3  # as near, but of the other type
    cvar[37] = cvar[35]  # nearer, but not of the training set
    found = nearest_rows(cvar, garment, train, [35, 36])
    assert found[0] == 3
    assert found[1] != 3
    assert garment[found].tolist() == garment[[35, 36]].tolist()


def test_every_variable_counts_alike_whatever_its_unit(data):
    _, _, garment, cvar, train = data
    units = np.geomspace(1e-3, 1e3, 13).astype(np.float32)
    rows = np.arange(30, 40)
    np.testing.assert_array_equal(
        nearest_rows(cvar * units, garment, train, rows), nearest_rows(cvar, garment, train, rows)
    )


def test_a_type_that_was_never_seen_gets_the_nearest_of_any(data):
    _, _, garment, cvar, train = data
    garment = garment.copy()
    garment[35] = 5
    assert nearest_rows(cvar, garment, train, [35])[0] in train


def test_pca_equals_the_singular_value_decomposition(data):
    offsets, mask, _, _, train = data
    pca = fit_pca(offsets, mask, train, components=4)
    flat = offsets[train].reshape(len(train), -1)
    _, values, axes = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    assert pca.explained == pytest.approx((values[:4] ** 2).sum() / (values**2).sum(), rel=1e-4)
    np.testing.assert_allclose(np.abs((pca.axes * axes[:4]).sum(1)), 1, atol=1e-3)
    code = axes[:4] @ (offsets[35].ravel() - flat.mean(0))
    expected = (flat.mean(0) + code @ axes[:4]).reshape(-1, 3)
    np.testing.assert_allclose(pca.rebuild(offsets[35])[0], expected, atol=1e-4)


def test_small_components_are_as_good_as_large_ones(monkeypatch):
    """Offsets of 10 m to 0.1 mm along known axes, in blocks that do not divide the coordinates."""
    monkeypatch.setattr(baselines, "_BLOCK", 7)
    rng = rng_for(0, "steep")
    axes = np.linalg.qr(rng.normal(size=(3 * VERTICES, 20)))[0].T
    sizes = np.geomspace(10, 1e-4, 20)
    offsets = ((rng.normal(size=(ROWS, 20)) * sizes) @ axes).astype(np.float32)
    offsets = offsets.reshape(ROWS, VERTICES, 3)
    pca = fit_pca(offsets, np.ones((ROWS, VERTICES), bool), np.arange(ROWS), components=12)
    np.testing.assert_allclose(pca.axes @ pca.axes.T, np.eye(12), atol=2e-6)
    flat = offsets.reshape(ROWS, -1).astype(np.float64)
    _, _, expected = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    np.testing.assert_allclose(np.abs((pca.axes * expected[:12]).sum(1)), 1, atol=1e-5)


def test_pca_gives_back_what_lies_in_its_span_mask_included(data):
    offsets, mask, _, _, train = data
    pca = fit_pca(offsets, mask, train, components=128)  # far more than there are
    assert len(pca.axes) <= 29
    rebuilt, covered = pca.rebuild(offsets[35])
    np.testing.assert_allclose(rebuilt, offsets[35], atol=1e-4)  # rank 6 in all
    np.testing.assert_array_equal(pca.rebuild(offsets[3])[1], mask[3])
    assert covered.dtype == bool


def test_no_baseline_learns_from_what_it_is_tested_on(data):
    offsets, mask, garment, cvar, train = data
    spoilt = offsets.copy()
    spoilt[30:] += 100
    names = ("mean_garment", "nearest_cvar")
    results = [
        static_baselines(o, mask, garment, cvar, train, types=2, components=5)
        for o in (offsets, spoilt)
    ]
    for name in names:
        np.testing.assert_array_equal(results[0][name](33)[0], results[1][name](33)[0])
    spoilt[33] = offsets[33]  # PCA may see the one that it rebuilds
    np.testing.assert_array_equal(results[0]["pca"](33)[0], results[1]["pca"](33)[0])


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_mean_wrinkles_are_those_of_the_type_freed_from_pose(toy_body):
    garments = [
        moving_garment(toy_body, "train", "Tshirt", wrinkle=wrinkle, seed=seed)
        for seed, wrinkle in enumerate((0.0, WRINKLE_M))
    ] + [moving_garment(toy_body, "train", "Dress", wrinkle=3 * WRINKLE_M)]
    bodies = dict.fromkeys(GENDERS, toy_body)
    mean = mean_wrinkles(garments, bodies, step=2)
    mask = garments[0].registered.mask
    for name, expected in (("Tshirt", WRINKLE_M / 2), ("Dress", 3 * WRINKLE_M), ("Top", 0)):
        wrinkles = mean[GARMENTS.index(name)]
        np.testing.assert_allclose(
            wrinkles[mask], np.tile([expected, 0, 0], (mask.sum(), 1)), atol=1e-5
        )
        assert (wrinkles[~mask] == 0).all()


def test_mean_wrinkles_are_means_over_the_garments_that_cover_a_vertex(toy_body):
    whole, short = (
        moving_garment(toy_body, "train", "Tshirt", wrinkle=WRINKLE_M, seed=seed) for seed in (0, 1)
    )
    kept = np.arange(len(short.registered.vertex)) % 2 == 0
    mask = np.zeros_like(short.registered.mask)
    mask[short.registered.vertex[kept]] = True
    parts = {
        name: getattr(short.registered, name)[kept]
        for name in ("vertex", "corner", "bary", "weights")
    }
    short = replace(short, registered=replace(short.registered, mask=mask, **parts))
    mean = mean_wrinkles([whole, short], dict.fromkeys(GENDERS, toy_body), step=2)
    wrinkles = mean[GARMENTS.index("Tshirt")][whole.registered.mask]
    np.testing.assert_allclose(wrinkles, np.tile([WRINKLE_M, 0, 0], (len(wrinkles), 1)), atol=1e-5)


def test_baselines_reach_what_their_data_allows(toy_body, topology):

    def garments(split, *seeds):
        for seed in seeds:
            yield moving_garment(toy_body, split, "Tshirt", wrinkle=WRINKLE_M, seed=seed)

    rows = moving_baseline_summary(
        garments("train", 0, 1),
        {"test": garments("test", 2, 3)},
        dict.fromkeys(GENDERS, toy_body),
        topology,
        step=1,
        seed=0,
    )
    still, mean = (
        find_value(rows, name, "test", "all", "surface_error_mm") for name in (STILL, MEAN)
    )
    # Blended joint motions shorten a shift a little, never lengthen it.
    assert 0.85 * 1000 * WRINKLE_M < still.value <= 1000 * WRINKLE_M + 1e-3
    assert mean.value < 1e-2
    assert still.n == 12
    assert find_value(rows, "moving", "test", "all", "surface_error_mm") is None
    assert find_value(rows, "moving", "test", "all", "inside_share").model == "truth"


def test_without_training_garments_there_is_one_sentence(toy_body, topology):
    with pytest.raises(InputError, match="no sample of the training split was accepted"):
        moving_baseline_summary(
            [],
            {"test": [moving_garment(toy_body, "test", "Tshirt")]},
            dict.fromkeys(GENDERS, toy_body),
            topology,
            step=1,
            seed=0,
        )
