import pytest
import torch

from drapeline.models.smplicit import network
from drapeline.models.smplicit.decoder import FieldDecoder
from drapeline.models.smplicit.network import Points, fit_codes

CLUSTERS, CUT, STYLE, GARMENTS, POINTS = 7, 2, 3, 3, 40


def draw(seed, *shape):
    rng = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=rng, dtype=torch.float64)


@pytest.fixture
def decoder():
    made = FieldDecoder(
        CLUSTERS, CUT, STYLE, width=0.1, rng=torch.Generator().manual_seed(0)
    ).double()
    with torch.no_grad():  # untrained weights hardly let codes through
        for name in ("fc0_cloth", "fc1_cloth", "fc0", "fc1", "fc2", "fc3"):
            getattr(made, name).weight_g.mul_(2)
    return made


@pytest.fixture
def points():
    return draw(1, GARMENTS, POINTS, 3), draw(2, GARMENTS, CLUSTERS, 3)


def predict(decoder, points, z):
    with torch.no_grad():
        return decoder(*points, *z.split([CUT, STYLE], 1))


def loss(decoder, points, distance, z, latent):
    return (predict(decoder, points, z) - distance).abs().mean(1) + latent * z.abs().mean(1)


def fit(decoder, points, distance, z, latent=0.0, steps=20):
    places, clusters = points
    return fit_codes(decoder, Points(places, distance), clusters, z, latent, steps)


def test_the_code_that_made_the_distances_is_found(decoder, points):
    true = draw(3, GARMENTS, CUT + STYLE)
    distance = predict(decoder, points, true)
    z = fit(decoder, points, distance, true + 0.05 * draw(4, GARMENTS, CUT + STYLE))
    torch.testing.assert_close(predict(decoder, points, z), distance, atol=1e-3, rtol=0)


def test_single_distances_that_are_wrong_hardly_matter(decoder, points):
    """Unlike a mean of squares, a mean of absolute values ignores outliers."""
    true = draw(3, GARMENTS, CUT + STYLE)
    distance = predict(decoder, points, true)
    wrong = distance.clone()
    wrong[:, ::10] += 1
    z = fit(decoder, points, wrong, true)
    error = (predict(decoder, points, z) - distance).abs().mean()
    assert error < 0.05  # of the 0.1 that they are off on the average


def test_derivatives_are_those_of_the_decoder(decoder, points):
    z = draw(5, GARMENTS, CUT + STYLE)
    query = decoder.query(points[0], *decoder.fold(points[1]))
    found = network._linearise(decoder, query, torch.zeros(GARMENTS, POINTS), 0.1, z)
    expected = torch.autograd.functional.jacobian(
        lambda code: decoder(*points, *code.split([CUT, STYLE], 1)), z
    )
    for index in range(GARMENTS):
        torch.testing.assert_close(found.slopes[index], expected[index, :, index])
    torch.testing.assert_close(found.residual, predict(decoder, points, z))
    distance = torch.zeros_like(found.residual)
    torch.testing.assert_close(found.loss, loss(decoder, points, distance, z, 0.1))


@pytest.mark.parametrize("latent", [0.0, 0.5])
def test_no_step_makes_a_code_worse(decoder, points, latent):
    z, distance = draw(6, GARMENTS, CUT + STYLE), draw(7, GARMENTS, POINTS).abs()
    losses = [loss(decoder, points, distance, z, latent)]
    for steps in range(1, 6):
        now = fit(decoder, points, distance, z, latent, steps)
        losses.append(loss(decoder, points, distance, now, latent))
        assert (losses[-1] <= losses[-2] + 1e-12).all()
    assert (losses[-1] < losses[0]).all()


def test_the_prior_alone_leads_to_zero(decoder, points):
    z = draw(8, GARMENTS, CUT + STYLE)
    distance = predict(decoder, points, torch.zeros_like(z))
    assert fit(decoder, points, distance, z, latent=100.0).abs().max() < 0.05


def test_garments_do_not_depend_on_one_another(decoder, points):
    z, distance = draw(6, GARMENTS, CUT + STYLE), draw(7, GARMENTS, POINTS).abs()
    together = fit(decoder, points, distance, z, 0.01)
    for index in range(GARMENTS):
        one = slice(index, index + 1)
        alone = fit(decoder, [value[one] for value in points], distance[one], z[one], 0.01)
        torch.testing.assert_close(alone[0], together[index])


def test_where_nothing_is_finite_the_code_stays(decoder, points):
    z, distance = draw(6, GARMENTS, CUT + STYLE), draw(7, GARMENTS, POINTS).abs()
    distance[1, 3] = float("nan")
    found = fit(decoder, points, distance, z)
    assert torch.equal(found[1], z[1])
    assert not torch.equal(found[0], z[0])


def test_no_steps_give_the_start(decoder, points):
    z = draw(6, GARMENTS, CUT + STYLE)
    assert torch.equal(fit(decoder, points, torch.zeros(GARMENTS, POINTS), z, steps=0), z)
