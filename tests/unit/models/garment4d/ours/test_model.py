"""First guesses, the regression that makes them, and our model from its folder."""

import shutil

import numpy as np
import pytest
import torch

from drapeline.bodies.model import posed_vertices
from drapeline.errors import DamagedFile, InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.models.garment4d.data import BodySet
from drapeline.models.garment4d.ours.body_maps import MapRegression, garment_maps
from drapeline.models.garment4d.ours.final_step import fit_final_step
from drapeline.models.garment4d.ours.labels import choose_labels
from drapeline.models.garment4d.ours.model import (
    OurModel,
    fit_regression,
    guess_all,
    save_our_model,
)
from drapeline.models.garment4d.reconstruct import NetworksModel
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.load import load
from drapeline.models.package import pack_model
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.registration.settings import RefineSettings
from drapeline.seeding import rng_for
from toys.garment4d import GARMENT, POSED, fill_regression
from toys.garment4d_stages import toy_guesser

REGRESSION = ("mean", "scale", "low", "high", "weight", "bias")
STARTS = (0, 3, 4)  # of windows of three frames that cover seven


@pytest.fixture
def guesser(labelling, sequences):
    """With untrained labels and a regression of random weights."""
    guesser = toy_guesser(labelling, sequences)
    fill_regression(guesser.regression)
    return guesser


def places(seen):
    """(F, P, 4) on the body."""
    body = seen.body
    return body_relative_points(body.model, body.shape, seen.poses, seen.points)[..., 3:]


# ---- first guesses ----------------------------------------------------------------------------


def test_labels_are_the_likeliest_of_what_is_worn_together(guesser, held_out):
    logits = guesser.labels.logits(held_out.points, places(held_out))
    expected = choose_labels(logits, GARMENT)
    assert len(np.unique(expected)) > 1
    np.testing.assert_array_equal(guesser.guess(held_out).labels, expected)
    np.testing.assert_array_equal(guesser.label_points(held_out), expected)


def test_the_garment_has_the_mean_coefficients_that_maps_of_all_windows_tell(
    guesser, data, held_out
):
    on_body = torch.from_numpy(places(held_out))
    labels = data.labels[data.rows(int(data.of_split("test")[0]))]
    chosen = torch.from_numpy(labels == data.label)
    maps = [garment_maps(on_body[None, s : s + 3], chosen[None, s : s + 3]) for s in STARTS]
    alpha = guesser.regression(torch.cat(maps)).mean(0).numpy()
    guess = guesser.guess(held_out._replace(labels=labels))
    np.testing.assert_array_equal(guess.labels, labels)
    np.testing.assert_allclose(guess.canonical, data.space.vertices(alpha), atol=1e-6)
    assert np.abs(guess.canonical - data.space.mean).max() > 1e-3
    assert guess.seconds > 0


def test_the_order_of_the_points_does_not_matter(guesser, held_out):
    guess = guesser.guess(held_out)
    order = rng_for(0, "order").permutation(held_out.points.shape[1])
    mixed = guesser.guess(held_out._replace(points=held_out.points[:, order]))
    np.testing.assert_array_equal(mixed.labels, guess.labels[:, order])
    np.testing.assert_allclose(mixed.canonical, guess.canonical, atol=1e-5)


def test_before_the_fit_every_guess_is_the_mean_garment(labelling, sequences, data, held_out):
    guess = toy_guesser(labelling, sequences).guess(held_out)
    np.testing.assert_allclose(guess.canonical, data.space.mean, atol=1e-6)


def test_a_sequence_shorter_than_a_window_is_refused(guesser, held_out):
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        guesser.guess(held_out.frames(np.arange(2)))


# ---- the regression ---------------------------------------------------------------------------


@pytest.fixture
def unfitted(labelling, sequences):
    return toy_guesser(labelling, sequences)


def test_the_regression_is_fitted_to_maps_of_clouds_as_they_are_and_worse(unfitted, data, clouds):
    known = fit_regression(unfitted, data, clouds)
    train = data.of_split("train").tolist()
    assert sorted(known) == [(sequence, worse) for sequence in train for worse in (False, True)]
    maps, owners, kinds = [], [], []
    for sequence, start in data.windows("train", 3, 3).tolist():
        plain, worse = data.rows(sequence), clouds.rows_of(data.name[sequence])
        for is_worse, places, labels in (
            (False, data.on_body[plain], data.labels[plain]),
            (True, clouds.on_worse_body[worse], clouds.worse_labels[worse]),
        ):
            on_body = torch.from_numpy(np.array(places[start : start + 3]))
            chosen = torch.from_numpy(labels[start : start + 3] == data.label)
            maps.append(garment_maps(on_body[None], chosen[None])[0].numpy())
            owners.append(sequence)
            kinds.append(is_worse)
    again = MapRegression(*maps[0].shape, len(data.space.components))
    left_out, _ = again.fit(np.stack(maps), data.coefficients[owners], owners, data.space.metric())
    for name in REGRESSION:
        found, expected = (getattr(each, name) for each in (unfitted.regression, again))
        torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)
    for (sequence, is_worse), alpha in known.items():
        own = [
            owner == sequence and kind == is_worse
            for owner, kind in zip(owners, kinds, strict=True)
        ]
        np.testing.assert_allclose(alpha, left_out[own].mean(axis=0), atol=1e-3)


def test_a_training_sequence_is_estimated_without_itself(unfitted, sequences, data, clouds):
    """So that it is as wrong as for new garments: the fit with it knows its garment by heart."""
    known = fit_regression(unfitted, data, clouds)
    for sequence in data.of_split("train").tolist():
        alpha = known[sequence, False]
        seen = sequences.seen(sequence, data.labels[data.rows(sequence)])
        found = data.space.coefficients(unfitted.guess(seen).canonical)
        assert np.abs(found - alpha).max() > 1e-3
        off = [data.coefficients[sequence] - each for each in (found, alpha)]
        with_it, without = ((each @ data.space.metric()) @ each for each in off)
        assert with_it < without


def test_with_one_training_sequence_every_guess_is_the_mean_garment(
    unfitted, data, clouds, held_out, caplog
):
    data.split = data.split.copy()
    data.split[data.of_split("train")[1:]] = "test"
    assert fit_regression(unfitted, data, clouds) == {}
    assert "only one training sequence: all first guesses are the mean garment" in caplog.text
    np.testing.assert_allclose(unfitted.guess(held_out).canonical, data.space.mean, atol=1e-6)


def test_the_final_step_is_shown_estimates_without_the_sequence_and_new_ones_in_validation(
    guesser, sequences, data, clouds
):
    known = {(4, False): np.array([1.0, 2.0]), (5, True): np.array([3.0, 4.0])}
    guesses = list(guess_all(guesser, sequences, clouds, known))
    # The other sequence of the validation split is moved by skinning, and has no folds.
    assert [one.sequence for one in guesses] == [4, 5, 7]
    for one, worse in zip(guesses, (False, True, False), strict=True):
        seen = sequences.seen(one.sequence)
        if worse:
            rows = clouds.rows_of(data.name[one.sequence])
            seen = seen._replace(points=clouds.worse_points[rows])
        own = guesser.guess(seen)
        np.testing.assert_array_equal(one.seen.points, seen.points)
        np.testing.assert_array_equal(one.seen.labels, own.labels)
        if (one.sequence, worse) in known:
            np.testing.assert_array_equal(one.alpha, known[one.sequence, worse])
        else:
            np.testing.assert_allclose(one.alpha, data.space.coefficients(own.canonical), atol=1e-4)


# ---- from its folder --------------------------------------------------------------------------


@pytest.fixture
def fitted(unfitted, sequences, clouds):
    """What a training ends with: the guesser, and the final step."""
    known = fit_regression(unfitted, sequences.data, clouds)
    guesses = guess_all(unfitted, sequences, clouds, known)
    skinning = SkinningSettings(**POSED["skinning"])
    step = fit_final_step(sequences, skinning, guesses, RefineSettings(rounds=2), "skinned")
    assert step.correction is not None
    return unfitted, step


def test_a_model_that_is_saved_gives_the_same_garments_again(
    fitted, sequences, data, held_out, tmp_path
):
    guesser, step = fitted
    save_our_model(tmp_path, guesser, step, sequences)
    model = OurModel(tmp_path, "cpu")
    assert (model.garment, model.points) == (GARMENT, data.points.shape[1])
    assert model.final_step.skinning == step.skinning
    for key in ("mean", "components", "faces"):
        np.testing.assert_array_equal(getattr(model.space, key), getattr(data.space, key))
    for name, array in sequences.bodies.arrays().items():
        np.testing.assert_array_equal(model.bodies.arrays()[name], array)
    guess, expected = (each.guess(held_out) for each in (model.guesser, guesser))
    np.testing.assert_array_equal(guess.labels, expected.labels)
    np.testing.assert_array_equal(guess.canonical, expected.canonical)
    laid = step(expected.canonical, held_out._replace(labels=expected.labels), model.refining)
    made = model.make(held_out)
    np.testing.assert_array_equal(made.labels, expected.labels)
    for key in ("canonical", "proposal", "final"):
        np.testing.assert_array_equal(getattr(made, key), getattr(laid, key))
    assert made.seconds > 0


def test_known_labels_are_taken_as_they_are(ours, data, held_out):
    labels = data.labels[data.rows(int(data.of_split("test")[0]))]
    made = ours.make(held_out._replace(labels=labels))
    np.testing.assert_array_equal(made.labels, labels)
    other = ours.make(held_out._replace(labels=np.roll(labels, 1, axis=1)))
    assert np.abs(other.canonical - made.canonical).max() > 1e-4


def test_how_garments_are_laid_on_points_may_be_changed(ours, held_out):
    plain = ours.make(held_out)
    ours.refining = RefineSettings(rounds=0)
    away = ours.make(held_out)
    np.testing.assert_array_equal(away.proposal, plain.proposal)
    laid_m, left_m = (np.abs(made.final - made.proposal).mean() for made in (plain, away))
    assert left_m < 0.8 * laid_m


def test_an_exact_body_is_left_as_it_is(ours, held_out):
    assert ours.fit_body(held_out) is held_out
    made, laid = ours.make(held_out), ours.lay(ours.guesser.guess(held_out), held_out)
    for key in ("labels", "canonical", "proposal", "final"):
        np.testing.assert_array_equal(getattr(made, key), getattr(laid, key))


@pytest.fixture
def inexact(data, held_out):
    """The held-out sequence with its labels and a body that is off, in the same way throughout."""
    rng = rng_for(0, "inexact")
    body = held_out.body
    bodies = BodySet({body.gender: body.model}, 30)
    return held_out._replace(
        poses=(held_out.poses + rng.normal(0, 0.05, 72)).astype(np.float32),
        body=bodies.of(body.gender, body.shape + rng.normal(0, 0.5, 10)),
        labels=data.labels[data.rows(int(data.of_split("test")[0]))],
    )


def body_error_m(seen, true):
    """Mean distance of the body's vertices from where they truly are in the world."""
    found, expected = (
        posed_vertices(each.body.model, each.body.shape, each.poses, each.trans)[0]
        for each in (seen, true)
    )
    return np.linalg.norm(found - expected, axis=-1).mean()


def test_a_body_that_is_not_exact_is_fitted_to_the_points(ours, held_out, inexact):
    found = ours.fit_body(inexact)
    assert body_error_m(found, held_out) < 0.5 * body_error_m(inexact, held_out)
    in_world = [(seen.points + seen.trans[:, None]) for seen in (found, inexact)]
    np.testing.assert_allclose(*in_world, atol=1e-6)
    assert np.ptp(found.trans - inexact.trans, axis=0).max() < 1e-6
    np.testing.assert_array_equal(found.labels, inexact.labels)


def test_garments_come_with_the_fitted_body_that_they_lie_on(ours, inexact):
    found = ours.fit_body(inexact)
    assert np.abs(found.trans - inexact.trans).max() > 1e-4
    made, laid = ours.make(inexact), ours.lay(ours.guesser.guess(found), found)
    for key in ("canonical", "proposal", "final"):
        np.testing.assert_allclose(getattr(made, key), getattr(laid, key), atol=1e-6)
    for key in ("points", "poses", "trans"):
        np.testing.assert_allclose(getattr(made.seen, key), getattr(found, key), atol=1e-6)
    np.testing.assert_allclose(made.seen.body.shape, found.body.shape, atol=1e-6)
    given = inexact.points + inexact.trans[:, None]
    moving = ours.reconstruct(
        given, inexact.poses, inexact.body.shape, trans=inexact.trans, least_share=0
    )
    assert np.abs(moving.trans - inexact.trans).max() > 1e-4
    assert np.abs(moving.shape - inexact.body.shape).max() > 1e-3


def test_without_labels_a_body_is_fitted_to_what_is_labelled_then(ours, inexact):
    unknown = inexact._replace(labels=None)
    found = ours.fit_body(unknown)
    assert found.labels is None
    made = ours.make(unknown)
    np.testing.assert_array_equal(made.labels, ours.guesser.guess(found).labels)


def test_the_folder_of_a_type_is_that_of_our_model(fitted_ours, trained_posed, tmp_path):
    folder = tmp_path / GARMENT
    shutil.copytree(fitted_ours, folder / "ours")
    shutil.copytree(trained_posed, folder / "posed")
    for place, kind in ((folder, OurModel), ("ours", OurModel), ("posed", NetworksModel)):
        model = load(folder / place)
        assert type(model) is kind
        assert model.garment == GARMENT
    # A model's own folder is meant before one within it.
    shutil.copytree(fitted_ours, folder / "posed" / "ours")
    assert type(load(folder / "posed")) is NetworksModel


@pytest.mark.portable
def test_packed_models_give_nearly_the_same(fitted_ours, trained_posed, held_out, tmp_path):
    """Half precision tells places of a metre apart by half a millimetre."""
    for name, folder in (("ours", fitted_ours), ("posed", trained_posed)):
        pack_model(folder, tmp_path / name)
        made, packed = (load(one).make(held_out) for one in (folder, tmp_path / name))
        assert (made.labels == packed.labels).mean() > 0.98
        for key in ("canonical", "final"):
            away = np.linalg.norm(getattr(packed, key) - getattr(made, key), axis=-1)
            assert away.mean() < 0.005, f"{name}: {key}"


@pytest.mark.parametrize("name", ["final_step.npz", "reconstruction.npz", BEST])
def test_a_missing_file_is_named(fitted_ours, tmp_path, name):
    shutil.copytree(fitted_ours, tmp_path / "ours")
    (tmp_path / "ours" / name).unlink()
    with pytest.raises(InputError, match=f"{name}: no such file"):
        OurModel(tmp_path / "ours", "cpu")


def test_a_template_whose_faces_name_vertices_that_are_not_there_is_refused(fitted_ours, tmp_path):
    shutil.copytree(fitted_ours, tmp_path / "ours")
    saved = read_checkpoint(fitted_ours / BEST)
    saved.metadata["space"]["faces"][0, 0] = 100_000
    write_checkpoint(tmp_path / "ours" / BEST, *saved)
    with pytest.raises(DamagedFile, match=rf"{BEST}: .*'faces' names number 100000"):
        OurModel(tmp_path / "ours", "cpu")


def test_other_networks_are_refused(fitted_ours, trained_posed):
    with pytest.raises(InputError, match="holds a 'garment4d_posed' network, expected garment4d_o"):
        OurModel(trained_posed, "cpu")
    with pytest.raises(InputError, match="holds a 'garment4d_ours' network, expected garment4d_p"):
        NetworksModel(fitted_ours, "cpu")
