import copy

import numpy as np
import pytest
import torch

from drapeline.bodies.moved_body import UNKNOWNS, BodyState, MovedBody
from drapeline.bodies.rest_body import shape_basis
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.scans import fit as fit_scans
from drapeline.models.smplicit.scans.fit import FittedScan, GarmentTerms, PointsAtRest, fit_to_cloth
from drapeline.models.smplicit.scans.points import FieldPoints
from drapeline.models.smplicit.settings import FitScan
from drapeline.outfits.worn import DrapedSheet

STEP = 1e-3
STATE = BodyState.of(
    REST_POSE + np.random.default_rng(0).normal(scale=0.1, size=72),
    np.array([0.1, 0.2, 1.0]),
    np.linspace(-0.5, 0.5, 10),
)


def around_hips(count):
    """(count, 3) metres, around the hips of `STATE`."""
    turn, height = np.random.default_rng(1).uniform([0, -0.3], [2 * np.pi, 0], (count, 2)).T
    circle = 0.25 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return STATE.trans + np.column_stack([circle, height])


@pytest.fixture(scope="module")
def terms(fitting_model):
    places = around_hips(40)
    points = FieldPoints(places, np.linspace(0, 0.05, 40), np.linspace(1, 3, 40))
    return GarmentTerms(fitting_model, "Skirt", points, "male", FitScan())


def differences(value, at):
    """(..., n) derivatives of a function by central differences."""
    columns = [(value(at + s) - value(at - s)) / (2 * STEP) for s in STEP * np.eye(len(at))]
    return np.stack(columns, axis=-1)


def test_the_field_is_the_models(terms, fitting_model):
    places, shape, w = around_hips(40) - STATE.trans, np.linspace(-1, 1, 10), np.ones(5)
    field = fitting_model.field(terms.code(w), gender="male", shape=shape)
    true = np.minimum(terms.points.distance_m / fitting_model.network.d_max_m, 1)
    expected = field.distances(places) / fitting_model.network.d_max_m - true
    np.testing.assert_allclose(terms.evaluate_field(places, shape, w).residual, expected, atol=1e-4)


def test_losses_of_several_codes_are_those_of_each(terms):
    places, shape = around_hips(40) - STATE.trans, np.linspace(-1, 1, 10)
    every = 3 * np.random.default_rng(4).normal(size=(3, 5))
    expected = [terms.loss(terms.evaluate_field(places, shape, w).residual, w) for w in every]
    np.testing.assert_allclose(terms.losses(places, shape, every), expected, rtol=1e-5)
    assert np.ptp(expected) > 1e-3 * max(expected)


def test_the_fit_takes_the_derivatives_of_the_field(terms):
    places, shape, w = around_hips(40) - STATE.trans, np.linspace(-1, 1, 10), np.full(5, 0.3)
    residual, by_code = terms.evaluate_code(terms.query(places, shape), w)
    look = terms.evaluate_field(places, shape, w)
    np.testing.assert_allclose(residual, look.residual, atol=1e-6)
    np.testing.assert_allclose(by_code, look.by_code, atol=1e-5 * np.abs(look.by_code).max())


def test_slopes_of_the_field_are_those_of_autograd(terms, fitting_model):
    places, shape, w = around_hips(40) - STATE.trans, np.linspace(-1, 1, 10), np.full(5, 0.3)
    network = fitting_model.network

    def distances(places, shape, w):
        clusters = network.places(shape[None], torch.tensor([1]))
        return network.predict(places[None], clusters, terms.prior.codes(w[None]))[0]

    given = tuple(torch.from_numpy(part.astype(np.float32)) for part in (places, shape, w))
    by_place, by_shape, by_code = torch.autograd.functional.jacobian(distances, given)
    look = terms.evaluate_field(places, shape, w)
    own = by_place[torch.arange(40), torch.arange(40)]
    for found, expected in (
        (look.by_place, own),
        (look.by_shape, by_shape),
        (look.by_code, by_code),
    ):
        scale = float(expected.abs().max())
        np.testing.assert_allclose(found, expected.numpy(), atol=1e-3 * scale)


def test_a_point_counts_by_its_weight(terms):
    """A point that counts twice is as good as the point and another one in its place."""
    once = np.ones(40)
    twice = np.where(np.arange(40) == 7, 2.0, once)
    residual, w = np.linspace(-0.5, 0.8, 40), np.zeros(5)
    again = np.append(residual, residual[7])

    def weighted(weight):
        other = copy.copy(terms)
        other.points = terms.points._replace(weight=weight)
        return other

    single, double = weighted(np.ones(41)), weighted(twice)
    assert double.loss(residual, w) == pytest.approx(single.loss(again, w))
    squares = single.weights(again) * again**2
    assert (double.weights(residual) * residual**2).sum() == pytest.approx(squares.sum())


@pytest.mark.parametrize("neighbours", [1, 4])
def test_points_come_back_to_where_they_were_at_rest(toy_body, neighbours):
    rest = MovedBody(toy_body, BodyState.of(REST_POSE, np.zeros(3), STATE.shape))
    points = around_hips(30)
    found = PointsAtRest(points - STATE.trans, rest, neighbours)
    np.testing.assert_allclose(found.places, points - STATE.trans, atol=1e-5)


def test_slopes_of_points_at_rest_are_the_differences(toy_body):
    points, along = around_hips(30), np.random.default_rng(2).normal(size=(30, 3))

    def value(change):
        moved = MovedBody(toy_body, STATE.step(change))
        return (PointsAtRest(points, moved, 1).places * along).sum(axis=1)

    body = MovedBody(toy_body, STATE)
    found = PointsAtRest(points, body, 1).slopes(along, shape_basis(toy_body)[1:])
    expected = differences(value, np.zeros(UNKNOWNS))
    # Another vertex may become the closest within a step.
    away = np.abs(found - expected) > 0.02 * np.abs(expected).max()
    assert away.any(axis=1).mean() < 0.2


def test_points_on_cloth_that_hangs_follow_it_back_to_rest(terms, toy_body, monkeypatch):
    """Its codes go on from where they are, and those of cloth that does not hang stay."""
    state = BodyState.of(REST_POSE, np.array([0.1, 0.2, 1.0]), np.zeros(10))
    rest = (around_hips(300) - STATE.trans).astype(np.float32)
    draped = (rest + state.trans + [0, 0.03, -0.1]).astype(np.float32)
    faces = np.arange(300, dtype=np.int32).reshape(-1, 3)
    seen = []

    def fit(places, shape, w):
        seen.append((places, shape, w))
        return w + 1

    part = copy.copy(terms)
    part.points = terms.points._replace(places=draped[:40].astype(np.float64))
    monkeypatch.setattr(part, "fit", fit, raising=False)
    given = []

    def toy_terms(*args):
        given.append(args)
        return MovedBody(toy_body, state), {"Skirt": part}

    monkeypatch.setattr(fit_scans, "_terms", toy_terms)
    z, other = terms.code(np.linspace(-0.5, 0.5, 5)), np.arange(3.0)
    found = FittedScan({"Skirt": z, "Top": other}, state)
    sheets = {"Skirt": DrapedSheet(Mesh(rest, faces), Mesh(draped, faces))}
    codes = fit_to_cloth("scan", {}, found, sheets, FitScan(), 7)
    assert given == [("scan", {}, ["Skirt"], state, FitScan(), 7)]
    ((places, shape, w),) = seen
    np.testing.assert_allclose(places, rest[:40], atol=1e-5)
    np.testing.assert_array_equal(shape, state.shape)
    np.testing.assert_allclose(terms.code(w), z, atol=1e-5)
    np.testing.assert_allclose(codes["Skirt"], terms.code(w + 1), atol=1e-5)
    assert codes["Top"] is other
