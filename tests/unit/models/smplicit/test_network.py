from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_codes
from drapeline.models.smplicit.network import Points, fit_codes, new_field
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import RATE_SHARE, Progress
from toys.learning import (
    assert_a_step_lowers,
    assert_learned_by_heart,
    assert_true_gradients,
    doubles,
    shake_weights,
)
from toys.smplicit import toy_bodies, toy_settings


@pytest.fixture
def model(fields, toy_body):
    return new_field("skirt", fields, toy_bodies(toy_body), toy_settings())


@pytest.fixture(scope="module")
def batch(fields):
    return as_tensors(fields.batch(fields.rows("train")))


def test_clusters_move_with_the_body(model, fields, toy_body):
    genders = torch.from_numpy(gender_codes(fields.gender))
    places = model.places(torch.from_numpy(fields.shape), genders)
    for row, shape in enumerate(fields.shape):
        expected = rest_body(toy_body, shape)[fields.clusters]
        np.testing.assert_allclose(places[row], expected, atol=1e-5)


def test_genders_have_bodies_of_their_own(fields, toy_body):
    taller = replace(toy_body, v_template=1.1 * toy_body.v_template)
    bodies = dict(zip(GENDERS, (toy_body, taller), strict=True))
    model = new_field("skirt", fields, bodies, toy_settings())
    female, male = model.places(torch.zeros(2, 10), torch.tensor([0, 1]))
    torch.testing.assert_close(male, 1.1 * female, atol=1e-5, rtol=0)


def test_gradients_are_true_and_a_step_lowers_the_loss(model, batch):
    model = shake_weights(model.double(), 0.05)
    model.place_basis = model.place_basis.double()
    given = doubles(batch)
    loss = lambda module: module.training_step(given)  # noqa: E731
    assert_true_gradients(model, loss)
    assert_a_step_lowers(model, loss)


def test_a_batch_is_learned_by_heart(fields, toy_body, batch):
    settings = toy_settings(learning_rate=5e-3, near=64, space=1)
    model = new_field("skirt", fields, toy_bodies(toy_body), settings)
    few = {key: value[:2] for key, value in batch.items()}
    few = {
        key: value[:, :8] if "near" in key or "space" in key else value
        for key, value in few.items()
    }
    assert_learned_by_heart(model, few, "distance_mm", steps=1000)


def test_points_differ_from_step_to_step_and_repeat_with_the_step(model, batch):
    found = []
    for step in (0, 1, 0):
        model.progress = Progress(0, step, 0)
        found.append(model._draw(batch))
    assert torch.equal(found[0].places, found[2].places)
    assert not torch.equal(found[0].places, found[1].places)
    assert found[0].places.shape == (4, 64, 3)
    near = batch["near"][0]
    assert all((near == point).all(1).any() for point in found[0].places[0, :32])


def test_distances_are_clipped_and_in_units_of_d_max(model, batch):
    points = model._draw(batch)
    assert points.distance.max() == 1
    first = points.places[0, 0]
    index = (batch["near"][0] == first).all(1).nonzero()[0]
    expected = batch["near_distance"][0, index] / 0.03
    torch.testing.assert_close(points.distance[0, :1], expected.clamp(max=1))


def test_the_published_optimiser_and_ours_train_the_same_parameters(fields, toy_body):
    for name in ("adam", "muon"):
        settings = toy_settings(optimizer=name)
        model = new_field("skirt", fields, toy_bodies(toy_body), settings)
        groups = model.optimizer().param_groups
        known = [id(p) for group in groups for p in group["params"]]
        assert sorted(known) == sorted(id(p) for p in model.parameters())
        shares = {group[RATE_SHARE] for group in groups}
        expected = {1.0, 0.05, 5.0} | ({20.0} if name == "muon" else set())
        assert shares == expected


@pytest.mark.portable
def test_codes_are_fitted_and_the_network_is_left(model, fields, batch):
    before = {name: value.clone() for name, value in model.state_dict().items()}
    model.eval()
    places = model.places(batch["shape"], batch["gender"])
    clipped = batch["near_distance"].clamp(max=model.d_max_m) / model.d_max_m
    start = torch.zeros(4, 5)

    def error(z):
        with torch.no_grad():
            return (model.predict(batch["near"], places, z) - clipped).abs().mean()

    z = fit_codes(model.decoder, Points(batch["near"], clipped), places, start, 1e-3, 5)
    assert error(z) < error(start)
    assert not z.requires_grad
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name]), name


@pytest.mark.portable
def test_the_validation_is_logged(model, fields):
    model.eval()
    model.validation_step(as_tensors(fields.batch(fields.rows("val"))))
    (logged,) = model.logged
    assert logged.rows == 2
    assert logged.values["val_distance_mm"] > 0


@pytest.mark.portable
def test_the_validation_takes_half_of_the_points_if_there_are_few(model, fields):
    model.eval()
    batch = as_tensors(fields.batch(fields.rows("val")))
    few = {
        name: value[:, :20] if name.startswith(("near", "space")) else value
        for name, value in batch.items()
    }
    model.validation_step(few)
    (logged,) = model.logged
    assert np.isfinite(logged.values["val_distance_mm"])
    for name in ("near_distance", "space_distance"):
        few[name] = few[name].clone()
        few[name][:, 10:] = torch.nan  # the half that codes are not fitted to
    model.validation_step(few)
    assert np.isnan(model.logged[1].values["val_distance_mm"])


def test_a_loss_that_is_not_finite_stops_the_training(model, batch):
    with torch.no_grad():
        model.decoder.fc4.bias.fill_(float("nan"))
    with pytest.raises(InputError, match="the loss is nan .* for samples s0/Skirt"):
        model.training_step(dict(batch))
