import numpy as np
import pytest
import torch

from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.pictures.fit import Evidence, image_loss, query_of
from drapeline.models.smplicit.settings import FitImage
from toys.smplicit import toy_bodies, toy_settings


@pytest.fixture(scope="module")
def model(fields, toy_body):
    return new_field("skirt", fields, toy_bodies(toy_body), toy_settings()).double().eval()


def evidence():
    rng = np.random.default_rng(0)
    on, off = rng.normal(size=(2, 3, 4, 3)), rng.normal(size=(2, 5, 2, 3))
    least, weight = rng.random((2, 5, 2)), rng.random((2, 5))
    return Evidence(*map(torch.from_numpy, (on, off, least, weight)))


def given(model):
    places = model.places(torch.zeros(2, 10).double(), torch.tensor([0, 1]))
    return places, torch.from_numpy(np.random.default_rng(1).normal(size=(2, 5)))


@pytest.mark.parametrize("clearance", [True, False])
def test_the_loss_is_equation_6(model, clearance):
    found = evidence()
    places, z = given(model)
    settings = FitImage(clearance=clearance, off_weight=0.7)
    expected = []
    for index in range(2):
        one = slice(index, index + 1)

        def distance(point, one=one):
            with torch.no_grad():
                return model.predict(point[None, None], places[one], z[one]).item()

        covered = [min(abs(distance(p)) for p in ray) for ray in found.on[index]]
        loss = np.mean(covered)
        for ray, least, weight in zip(
            found.off[index], found.least[index], found.weight[index], strict=True
        ):
            short = [float(low) - distance(p) for p, low in zip(ray, least, strict=True)]
            worst = max(max(s, 0) for s in short) if clearance else max(map(abs, short))
            loss += 0.7 * float(weight) * worst
        expected.append(loss)
    with torch.no_grad():
        loss = image_loss(model, found, query_of(model, found, places), z, settings)
    np.testing.assert_allclose(loss, expected, rtol=1e-9)


def test_many_codes_are_compared_on_one_garment(model):
    found = Evidence(*(part[:1] for part in evidence()))
    places, z = given(model)
    query = query_of(model, found, places[:1])
    with torch.no_grad():
        together = image_loss(model, found, query, z, FitImage())
        alone = [image_loss(model, found, query, one[None], FitImage()) for one in z]
    torch.testing.assert_close(together, torch.cat(alone))
    assert together[0] != together[1]


def test_its_gradient_is_true(model):
    found = evidence()
    places, z = given(model)
    z.requires_grad_(True)
    settings, query = FitImage(), query_of(model, found, places)
    (slope,) = torch.autograd.grad(image_loss(model, found, query, z, settings).sum(), z)
    step = torch.randn(z.shape, generator=torch.Generator().manual_seed(2), dtype=z.dtype)
    with torch.no_grad():
        up, down = (
            image_loss(model, found, query, z + sign * 1e-7 * step, settings).sum()
            for sign in (1, -1)
        )
    expected = (slope * step).sum()
    assert abs((up - down) / 2e-7 - expected) < 1e-4 * (slope.norm() * step.norm())
