import numpy as np
import pytest
import torch

from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.surface.fields import NetworkField
from toys.smplicit import toy_bodies, toy_settings

Z, SHAPE = np.linspace(-0.3, 0.4, 5), np.linspace(-1, 1, 10)


@pytest.fixture(scope="module")
def model(fields, toy_body):
    return new_field("skirt", fields, toy_bodies(toy_body), toy_settings()).eval()


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-0.5, 0.5, (9000, 3)).astype(np.float32)


def test_distances_are_the_networks_in_metres(model, points):
    field = NetworkField(model, Z, SHAPE, "male")
    places = model.places(torch.tensor(SHAPE[None], dtype=torch.float32), torch.tensor([1]))
    z = torch.tensor(Z[None], dtype=torch.float32)
    with torch.no_grad():
        expected = model.predict(torch.from_numpy(points)[None], places, z)[0] * model.d_max_m
    np.testing.assert_allclose(field.distances(points), expected, atol=1e-6)
    np.testing.assert_allclose(field.distances(points[:3]), expected[:3], atol=1e-6)
    assert field.distances(points[:0]).shape == (0,)


def test_gradients_are_those_of_the_distances(model, points):
    field = NetworkField(model, Z, SHAPE, "female")
    some = points[:200]
    distances, slopes = field.gradients(some)
    np.testing.assert_allclose(distances, field.distances(some), atol=1e-7)
    for axis in range(3):
        step = np.zeros(3, np.float32)
        step[axis] = 1e-3
        change = (field.distances(some + step) - field.distances(some - step)) / 2e-3
        # Where a ReLU bends in between, the difference lies between two slopes.
        assert np.median(np.abs(change - slopes[:, axis])) < 1e-4
    empty = field.gradients(points[:0])
    assert empty[0].shape == (0,)
    assert empty[1].shape == (0, 3)
