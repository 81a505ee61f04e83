"""Predictions of garments in motion without a network, and their metrics."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.models.gcvae.data import DynamicGarments
from drapeline.models.gcvae.moving_baselines import (
    MEAN,
    MEAN_GARMENT,
    PCA,
    PENALTIES,
    RIDGE,
    STILL,
    MovingBaselines,
    WrinkleRows,
    fit_ridge,
    moving_baseline_summary,
)
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from toys.metric_rows import find_value
from toys.moving import moving_data, moving_garment

WRINKLE_M = 0.01
TSHIRT, DRESS = GARMENTS.index("Tshirt"), GARMENTS.index("Dress")


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def garment(body, split, seed, *, name="Tshirt", wrinkle=WRINKLE_M):
    return moving_garment(body, split, name, wrinkle=wrinkle, seed=seed)


def baselines_of(garments, body, components=3):
    data = moving_data(garments, body)
    codes = np.zeros((len(garments), 1), dtype=np.float32)
    return MovingBaselines(DynamicGarments(data, codes, 1), None, components=components, seed=0)


def wrinkles_of(baselines, moving):
    """Name -> (n, M, 3) of the vertices that the garment covers."""
    found = baselines.wrinkles(baselines.data.rows_of(moving.sample, moving.name))
    return {name: offsets[:, moving.registered.mask] for name, offsets in found.items()}


def test_wrinkles_of_a_type_are_those_of_its_training_garments(toy_body):
    """No motion carries a wrinkle further than its type has it on average, but the truth does."""
    shirts = [garment(toy_body, "train", k, wrinkle=k * WRINKLE_M) for k in (0, 1)]
    dress = garment(toy_body, "train", 2, name="Dress", wrinkle=3 * WRINKLE_M)
    tested = garment(toy_body, "test", 3, wrinkle=9 * WRINKLE_M)
    others = [garment(toy_body, "val", 4), dress, tested]
    found = wrinkles_of(baselines_of([*shirts, *others], toy_body), tested)
    assert not found[STILL].any()
    np.testing.assert_allclose(found[MEAN] - [WRINKLE_M / 2, 0, 0], 0, atol=1e-5)
    of_dress = wrinkles_of(baselines_of([*shirts, *others], toy_body), dress)
    np.testing.assert_allclose(of_dress[MEAN] - [3 * WRINKLE_M, 0, 0], 0, atol=1e-5)


def test_the_mean_garment_stands_in_the_place_of_the_true_one(toy_body):
    """A training garment 2 cm wider at rest: its wrinkles are added to the mean of both."""
    narrow, wide = (garment(toy_body, "train", k, wrinkle=0.0) for k in (0, 1))
    far = replace(wide.registered, offsets=2 * wide.registered.offsets)
    wide = replace(wide, registered=far)
    every = [narrow, wide, garment(toy_body, "val", 2), garment(toy_body, "test", 3)]
    baselines = baselines_of(every, toy_body)
    found, still = wrinkles_of(baselines, narrow), narrow.registered
    mean = (still.offsets + far.offsets)[still.mask] / 2
    np.testing.assert_allclose(
        found[MEAN_GARMENT] + still.offsets[still.mask], found[MEAN] + mean, atol=1e-6
    )


def test_pca_sees_the_frame_and_rebuilds_what_it_spans(toy_body):
    trained = [garment(toy_body, "train", k, wrinkle=k * WRINKLE_M) for k in range(3)]
    tested = garment(toy_body, "test", 9, wrinkle=5 * WRINKLE_M)
    found = wrinkles_of(
        baselines_of([*trained, garment(toy_body, "val", 4), tested], toy_body), tested
    )
    np.testing.assert_allclose(found[PCA] - [5 * WRINKLE_M, 0, 0], 0, atol=1e-4)


def rows_of(cvar, slope, noise=0.0, seed=0):
    """Two vertices whose wrinkles are linear in conditions, about one mean per type."""
    rng = rng_for(seed, "ridge")
    types = np.arange(len(cvar)) % 2
    mean = np.zeros((len(GARMENTS), 2, 3), dtype=np.float32)
    mean[1] = 0.3
    offsets = mean[types] + (cvar @ slope).reshape(-1, 2, 3)
    offsets += rng.normal(0, noise, offsets.shape) if noise else 0
    mask = np.ones((len(cvar), 2), dtype=bool)
    return WrinkleRows(offsets.astype(np.float32), mask, cvar, types)


def test_what_is_linear_in_conditions_is_found_without_a_penalty():
    rng = rng_for(0, "conditions")
    slope = rng.normal(size=(4, 6))
    training = rows_of(rng.normal(size=(400, 4)), slope)
    validation = rows_of(rng.normal(size=(50, 4)), slope)
    ridge = fit_ridge(training, validation)
    assert ridge.penalty == PENALTIES[0]
    found = ridge.predict(validation.garment, validation.cvar)
    # A penalty of one frame in 400.
    np.testing.assert_allclose(found, validation.offsets, atol=0.05)
    reached = 1000 * np.linalg.norm(found - validation.offsets, axis=2).mean()
    assert ridge.errors_mm[ridge.penalty] == pytest.approx(reached, rel=1e-3)


def test_what_conditions_do_not_tell_is_left_to_the_mean_of_the_type(tmp_path):
    """Few frames and noise alone: the strongest penalty errs least."""
    rng = rng_for(1, "conditions")
    nothing = np.zeros((30, 6))
    training = rows_of(rng.normal(size=(31, 30)), nothing, noise=0.1)
    validation = rows_of(rng.normal(size=(200, 30)), nothing, noise=0.1, seed=1)
    ridge = fit_ridge(training, validation)
    assert ridge.penalty > 1000
    found = ridge.predict(validation.garment, validation.cvar)
    np.testing.assert_allclose(found, ridge.mean[validation.garment], atol=0.01)
    ridge.save(tmp_path / "ridge.json")
    saved = json.loads((tmp_path / "ridge.json").read_text())
    assert saved["penalty"] == ridge.penalty
    assert len(saved["validation_surface_error_mm"]) == len(PENALTIES)


def test_vertices_that_a_garment_does_not_cover_say_nothing():
    rng = rng_for(0, "conditions")
    slope = rng.normal(size=(4, 6))
    training = rows_of(rng.normal(size=(100, 4)), slope)
    validation = rows_of(rng.normal(size=(50, 4)), slope)
    spoilt = replace(validation, mask=np.tile([True, False], (50, 1)))
    spoilt.offsets[:, 1] = 7.0
    whole = fit_ridge(training, replace(validation, mask=spoilt.mask))
    again = fit_ridge(training, spoilt)
    assert whole.errors_mm == again.errors_mm


def test_baselines_reach_what_their_data_allows(toy_body, topology):
    tested = [garment(toy_body, "test", k) for k in (2, 3)]
    trained = [garment(toy_body, "train", k) for k in (0, 1)]
    rows = moving_baseline_summary(
        baselines_of([*trained, garment(toy_body, "val", 4), *tested], toy_body),
        {"test": tested, "train": trained},
        dict.fromkeys(GENDERS, toy_body),
        topology,
        seed=0,
    )
    errors = {
        name: find_value(rows, name, "test", "all", "surface_error_mm")
        for name in (STILL, MEAN, MEAN_GARMENT, RIDGE, PCA)
    }
    # Blended joint motions shorten a shift a little, never lengthen it.
    assert 0.85 * 1000 * WRINKLE_M < errors[STILL].value <= 1000 * WRINKLE_M + 1e-3
    for name in (MEAN, RIDGE, PCA):
        assert errors[name].value < 1e-2, name
    assert errors[STILL].n == 12
    assert find_value(rows, MEAN, "train", "all", "surface_error_mm").n == 12
    assert find_value(rows, "moving", "test", "all", "surface_error_mm") is None
    assert find_value(rows, "moving", "test", "all", "inside_share").model == "truth"


@pytest.mark.parametrize("missing", ["train", "val"])
def test_without_frames_to_learn_from_there_is_one_sentence(toy_body, missing):
    (there,) = {"train", "val"} - {missing}
    with pytest.raises(InputError, match=f"no sample of the {missing} split was accepted"):
        baselines_of([garment(toy_body, there, 0), garment(toy_body, "test", 1)], toy_body)
