"""Predictions without a network, and their metrics."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.metrics import baselines
from drapeline.metrics.baselines import (
    fit_mean_garment,
    fit_pca,
    fit_training_pca,
    garment_baselines,
    nearest_rows,
)
from drapeline.seeding import rng_for
from toys.gcvae import ToyGarments, tube_mirror

ROWS, VERTICES = 40, 30


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
    pca = fit_pca(offsets[train], mask[train], components=4)
    flat = offsets[train].reshape(len(train), -1)
    _, _, axes = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    np.testing.assert_allclose(np.abs((pca.axes * axes[:4]).sum(1)), 1, atol=1e-3)
    code = axes[:4] @ (offsets[35].ravel() - flat.mean(0))
    expected = (flat.mean(0) + code @ axes[:4]).reshape(-1, 3)
    np.testing.assert_allclose(pca.reconstruct(offsets[35])[0], expected, atol=1e-4)
    # Shorter codes are those of fewer components.
    fewer = fit_pca(offsets[train], mask[train], components=2)
    for found, fitted in zip(
        pca.first(2).reconstruct(offsets[35]), fewer.reconstruct(offsets[35]), strict=True
    ):
        np.testing.assert_allclose(found, fitted, atol=1e-4)


def test_small_components_are_as_good_as_large_ones(monkeypatch):
    """Offsets of 10 m to 0.1 mm along known axes, in blocks that do not divide the coordinates."""
    monkeypatch.setattr(baselines, "_BLOCK", 7)
    rng = rng_for(0, "steep")
    axes = np.linalg.qr(rng.normal(size=(3 * VERTICES, 20)))[0].T
    sizes = np.geomspace(10, 1e-4, 20)
    offsets = ((rng.normal(size=(ROWS, 20)) * sizes) @ axes).astype(np.float32)
    offsets = offsets.reshape(ROWS, VERTICES, 3)
    pca = fit_pca(offsets, np.ones((ROWS, VERTICES), bool), components=12)
    np.testing.assert_allclose(pca.axes @ pca.axes.T, np.eye(12), atol=2e-6)
    flat = offsets.reshape(ROWS, -1).astype(np.float64)
    _, _, expected = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    np.testing.assert_allclose(np.abs((pca.axes * expected[:12]).sum(1)), 1, atol=1e-5)


def test_pca_gives_back_what_lies_in_its_span_mask_included(data):
    offsets, mask, _, _, train = data
    pca = fit_pca(offsets[train], mask[train], components=128)  # far more than there are
    assert len(pca.axes) <= 29
    rebuilt, covered = pca.reconstruct(offsets[35])
    np.testing.assert_allclose(rebuilt, offsets[35], atol=1e-4)  # rank 6 in all
    np.testing.assert_array_equal(pca.reconstruct(offsets[3])[1], mask[3])
    assert covered.dtype == bool


def guesses(offsets, mask, garment, cvar, train):
    """The baselines that are fitted to the rows `train`."""
    return garment_baselines(
        SimpleNamespace(
            offsets=offsets,
            mask=mask,
            garment=garment,
            cvar=lambda rows: cvar[rows],
            rows={"train": train}.__getitem__,
        )
    )


def test_baselines_guess_the_mean_of_the_type_and_the_nearest_garment(data):
    offsets, mask, garment, cvar, train = data
    found = guesses(*data)
    mean = fit_mean_garment(offsets, mask, garment, train, types=2)
    (near,) = nearest_rows(cvar, garment, train, [35])
    expected = {"mean_garment": (mean.offsets[1], mean.mask[1])}
    expected["nearest_cvar"] = offsets[near], mask[near]
    assert found.keys() == expected.keys()
    for name, guess in expected.items():
        for part, wanted in zip(found[name](35), guess, strict=True):
            np.testing.assert_array_equal(part, wanted)


def test_no_baseline_learns_from_what_it_is_tested_on(data):
    offsets, *about, train = data
    spoilt = offsets.copy()
    spoilt[30:] += 100
    exact, found = (guesses(one, *about, train) for one in (offsets, spoilt))
    for name in exact:
        np.testing.assert_array_equal(exact[name](33)[0], found[name](33)[0])
    # PCA may see the one that it rebuilds.
    mask = about[0]
    exact, found = (fit_pca(one[train], mask[train], 5) for one in (offsets, spoilt))
    np.testing.assert_array_equal(
        exact.reconstruct(offsets[33])[0], found.reconstruct(offsets[33])[0]
    )


def test_pca_learns_from_training_rows_and_their_mirror_images():
    """Components of the toys' own left and right, and a mean that is its own mirror image."""
    garments, mirror = ToyGarments(), tube_mirror()
    garments.offsets[:, :5] += np.float32([0.01, 0.02, 0.0])  # on one side alone
    rows = garments.rows("train")
    own = garments.offsets[rows]
    images = own[:, mirror] * np.float32([-1, 1, 1])
    mask = garments.mask[rows]
    expected = fit_pca(
        np.concatenate([own, images]), np.concatenate([mask, mask[:, mirror]]), components=6
    )
    garments.offsets[garments.rows("val")] = 7.0
    found = fit_training_pca(garments, mirror, components=6, seed=0)
    np.testing.assert_array_equal(found.axes, expected.axes)
    np.testing.assert_array_equal(found.mask_axes, expected.mask_axes)
    mean = found.mean.reshape(-1, 3)
    np.testing.assert_allclose(mean[mirror] * [-1, 1, 1], mean, atol=1e-7)
