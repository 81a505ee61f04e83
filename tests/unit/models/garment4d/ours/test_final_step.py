"""The garment at rest corrected by its points, and laid on them."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.models.garment4d.data import propose_garment
from drapeline.models.garment4d.ours.final_step import (
    FINAL_STEP_FORMS,
    FinalStep,
    Guess,
    fit_final_step,
    load_final_step,
    measure_worn_garments,
    training_worn_statistics,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.registration.settings import RefineSettings
from drapeline.registration.to_points import springs
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz
from toys.gcvae import tube, tube_faces

FACES = tube_faces(False)
SKINNING = SkinningSettings(neighbours=16, passes=5)
# Thirty body points tell nothing of where the body ends: no gap is asked for.
SETTINGS = RefineSettings(gap_m=-1.0)


def seen(sequences, sequence):
    """With the true labels."""
    data = sequences.data
    return sequences.seen(sequence, data.labels[data.rows(sequence)])


def plain(data):
    return FinalStep(data.space, data.label, SKINNING)


def test_a_known_garment_follows_the_points_and_keeps_to_the_cloth(sequences, data):
    """Points are on a skirt that sways by up to 10 cm off its skinning, back and forth."""
    sequence = int(data.of_split("train", ("simulated",))[0])
    rest, given = data.canonical[sequence], seen(sequences, sequence)
    skinned = propose_garment(given.body, given.poses, rest, data.space.faces, SKINNING)
    depth = (rest[:, 2].max() - rest[:, 2]) / np.ptp(rest[:, 2])
    sway = 0.1 * np.sin(0.4 * np.arange(len(skinned)))[:, None] * depth
    true = skinned + sway[..., None] * [0, 1, 0]
    own, points = given.labels[0] == data.label, np.array(given.points)
    points[:, own] = true[:, np.resize(np.arange(len(rest)), own.sum())]
    laid = plain(data).lay(rest, given._replace(points=points), SETTINGS)
    np.testing.assert_allclose(laid.proposal, skinned, atol=1e-6)
    np.testing.assert_array_equal(laid.canonical, rest)
    before, after = (np.linalg.norm(x - true, axis=-1).mean() for x in (skinned, laid.final))
    assert after < 0.7 * before


def upright_stretch(data, evidence):
    """Mean over the springs that run upwards."""
    pairs = springs(data.space.faces)[0]
    away = data.space.mean[pairs[:, 0]] - data.space.mean[pairs[:, 1]]
    upright = np.abs(away[:, 2]) > 2 * np.linalg.norm(away[:, :2], axis=1)
    assert upright.any()
    return evidence[0, : len(pairs)][upright].mean()


def test_springs_of_a_guess_that_is_too_short_become_longer(sequences, data):
    sequence = int(data.of_split("test")[0])
    true, given, step = data.canonical[sequence], seen(sequences, sequence), plain(data)
    top = true[:, 2].max()
    short, long = (
        np.column_stack([true[:, :2], top + share * (true[:, 2] - top)]).astype(np.float32)
        for share in (0.8, 1.25)
    )
    at_short, at_long = (
        upright_stretch(data, step.evidence(guess, given)) for guess in (short, long)
    )
    assert at_short > 0.02
    assert at_short > at_long + 0.03


def guesses(data, sequences):
    """Off in a coefficient, by as much as it varies."""
    rng = rng_for(0, "guesses")
    for split in ("train", "val"):
        for sequence in data.of_split(split).tolist():
            off = np.zeros_like(data.coefficients[sequence])
            off[0] = rng.normal()
            alpha = data.coefficients[sequence] + off
            yield Guess(seen(sequences, sequence), sequence, alpha)


def test_what_training_found_comes_back(sequences, data, tmp_path):
    step = fit_final_step(sequences, SKINNING, guesses(data, sequences), SETTINGS, "skinned")
    assert step.simulated_error_m is None
    save_npz(tmp_path / "step.npz", **step.arrays())
    found = load_npz(tmp_path / "step.npz", FINAL_STEP_FORMS)
    again = load_final_step(found, data.space, data.label, SKINNING)
    wanted = training_worn_statistics(sequences, SKINNING)
    for part, expected in zip(again.statistics, wanted, strict=True):
        np.testing.assert_array_equal(part, expected)
    sequence = int(data.of_split("test")[0])
    given = seen(sequences, sequence)
    made, wanted = (one(data.space.mean, given, SETTINGS) for one in (again, step))
    for part, expected in zip(made, wanted, strict=True):
        np.testing.assert_array_equal(part, expected)
    # Corrected, within the space of the type's garments.
    assert np.abs(made.canonical - data.space.mean).max() > 1e-4
    back = data.space.vertices(data.space.coefficients(made.canonical))
    np.testing.assert_allclose(back, made.canonical, atol=1e-4)


def test_a_correction_is_what_the_regression_says_of_the_evidence(sequences, data):
    step = fit_final_step(sequences, SKINNING, guesses(data, sequences), SETTINGS, "skinned")
    given = seen(sequences, int(data.of_split("test")[0]))
    change = step.correction(torch.from_numpy(step.evidence(data.space.mean, given))[None])
    expected = data.space.vertices(change[0].numpy())
    np.testing.assert_allclose(step.correct(data.space.mean, given), expected, atol=1e-6)


def test_a_correction_is_no_larger_than_errors_of_first_guesses_were(sequences, data):
    step = fit_final_step(sequences, SKINNING, guesses(data, sequences), SETTINGS, "skinned")
    given = seen(sequences, int(data.of_split("test")[0]))
    wild = replace(step, correction=copy.deepcopy(step.correction))
    wild.correction.bias += 50.0
    away = wild.correct(data.space.mean, given) - data.space.mean
    moved_m = np.sqrt((away.astype(np.float64) ** 2).sum(axis=-1).mean())
    assert moved_m == pytest.approx(step.most_m, rel=0.01)
    largest = max(
        np.sqrt(((data.canonical[g.sequence] - data.space.vertices(g.alpha)) ** 2).sum(-1).mean())
        for g in guesses(data, sequences)
    )
    assert step.most_m == pytest.approx(largest, rel=0.05)


def test_simulated_proposals_count_for_as_much_as_they_were_right_in_validation(
    sequences, data, tmp_path, monkeypatch
):
    validated = iter(data.of_split("val").tolist())

    def three_centimetres_off(*_):
        return data.garment[data.rows(next(validated))] + np.float32([0, 0.03, 0])

    module = "drapeline.models.garment4d.ours.final_step"
    monkeypatch.setattr(f"{module}.simulate_proposals", three_centimetres_off)
    step = fit_final_step(sequences, SKINNING, guesses(data, sequences), SETTINGS, "simulated")
    np.testing.assert_allclose(step.simulated_error_m, 0.03, rtol=1e-4)
    save_npz(tmp_path / "step.npz", **step.arrays())
    found = load_npz(tmp_path / "step.npz", FINAL_STEP_FORMS)
    again = load_final_step(found, data.space, data.label, SKINNING)
    np.testing.assert_array_equal(again.simulated_error_m, step.simulated_error_m)


def test_without_simulated_training_sequences_there_are_no_statistics(sequences, data, tmp_path):
    data.source = np.full_like(data.source, "skinned")
    step = fit_final_step(sequences, SKINNING, [], SETTINGS, "skinned")
    save_npz(tmp_path / "step.npz", **step.arrays())
    found = load_npz(tmp_path / "step.npz", FINAL_STEP_FORMS)
    again = load_final_step(found, data.space, data.label, SKINNING)
    assert step.statistics is again.statistics is None


def test_without_first_guesses_nothing_is_corrected(sequences, data):
    step = fit_final_step(sequences, SKINNING, [], SETTINGS, "best")
    assert step.correction is None
    assert step.simulated_error_m is None
    given = seen(sequences, int(data.of_split("test")[0]))
    np.testing.assert_array_equal(step.correct(data.space.mean, given), data.space.mean)


def test_worn_statistics_are_means_over_sequences_with_one_of_the_mean():
    rest = tube()
    moving = rest + 0.01 * np.sin(2 * np.arange(6))[:, None, None] * np.array([0, 0, 1.0])
    half = rest + 0.5 * (moving - rest)
    found = measure_worn_garments([half], [moving], [rest], FACES)
    np.testing.assert_allclose(found.shares, 1, atol=1e-9)
    np.testing.assert_allclose(found.follow, 0.5)
    wanted = np.sqrt(((half - moving)[:, 0] ** 2).sum(1).mean())
    np.testing.assert_allclose(found.error_m, wanted)
    # Twice as high, in one of two sequences: upright springs have shares of 1 and 2.
    high = moving * [1, 1, 2]
    found = measure_worn_garments([moving, high], [moving, high], [rest, rest], FACES)
    pairs = springs(FACES)[0]
    upright = np.linalg.norm((rest[pairs[:, 0]] - rest[pairs[:, 1]])[:, :2], axis=1) < 1e-9
    level = np.abs(rest[pairs[:, 0], 2] - rest[pairs[:, 1], 2]) < 1e-9
    assert upright.any()
    assert level.any()
    mean = (3 * found.shares[level][0] - 2) / 1
    np.testing.assert_allclose(found.shares[level], (1 + 1 + mean) / 3)
    np.testing.assert_allclose(found.shares[upright], (1 + 2 + mean) / 3)
    assert 1 < mean < 1.5
    np.testing.assert_allclose(found.follow, 1)
    np.testing.assert_allclose(found.error_m, 0, atol=1e-9)


def test_worn_statistics_are_those_beside_proposals_of_the_skinning_asked_for(sequences):
    # Toy garments are skinned like this, and sway by up to 2 cm.
    own = training_worn_statistics(sequences, SkinningSettings(neighbours=16, passes=5))
    other = training_worn_statistics(sequences, SkinningSettings(neighbours=1, passes=0))
    assert own.error_m.max() < 0.021
    assert own.error_m.mean() < 0.9 * other.error_m.mean()
    np.testing.assert_allclose(own.shares, other.shares)
