"""The shape space of canonical garments: exact where it has to be, standardised as released."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.registration.to_template.garment_space import fit_space, load_space

FACES = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.int32)


@pytest.fixture(scope="module")
def garments():
    """Twelve garments that vary in four directions, from a decimetre down to a millimetre."""
    rng = np.random.default_rng(3)
    ways = rng.normal(0, 1, (4, 40, 3)) * np.array([0.1, 0.05, 0.01, 0.001])[:, None, None]
    return rng.normal(0, 1, (40, 3)) + np.einsum("sd,dnc->snc", rng.normal(0, 1, (12, 4)), ways)


def test_training_garments_come_back_from_their_coefficients(garments):
    space = fit_space(garments, 64, FACES)
    alpha = space.coefficients(garments)
    np.testing.assert_allclose(space.vertices(alpha), garments, atol=2e-6)
    assert alpha.shape == (12, 4)  # no direction but the four there are


def test_coefficients_have_mean_zero_variance_one_and_no_correlation(garments):
    alpha = fit_space(garments, 4, FACES).coefficients(garments).astype(np.float64)
    np.testing.assert_allclose(alpha.mean(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(alpha.T @ alpha / len(alpha), np.eye(4), atol=1e-4)


def test_a_component_is_metres_per_unit_of_its_coefficient(garments):
    space = fit_space(garments, 3, FACES)
    moved = space.vertices(np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(moved - space.mean, 2 * space.components[1], atol=1e-6)
    np.testing.assert_allclose(space.vertices(np.zeros((2, 3))), [space.mean] * 2)


def test_the_first_component_is_that_of_the_correlation_matrix(garments):
    space = fit_space(garments, 1, FACES)
    flat = garments.reshape(12, -1)
    scale = np.maximum(flat.std(axis=0), 0.002)
    values, vectors = np.linalg.eigh(np.cov(((flat - flat.mean(0)) / scale).T, bias=True))
    expected = np.sqrt(values[-1]) * vectors[:, -1] * scale
    found = space.components[0].ravel()
    np.testing.assert_allclose(np.abs(found), np.abs(expected), atol=1e-6)
    assert abs(found @ expected) == pytest.approx((found @ found), rel=1e-4)
    np.testing.assert_allclose(space.explained, values[-1] / values.sum(), rtol=1e-6)


def test_explained_shares_fall_and_sum_to_one_when_all_are_kept(garments):
    explained = fit_space(garments, 64, FACES).explained
    assert (np.diff(explained) <= 0).all()
    assert explained.sum() == pytest.approx(1)
    np.testing.assert_allclose(fit_space(garments, 2, FACES).explained, explained[:2])


def test_a_new_garment_is_met_as_closely_as_standardised_metres_allow(garments):
    space = fit_space(garments, 3, FACES)
    new = garments[0] + np.random.default_rng(0).normal(0, 0.02, (40, 3))
    basis = (space.components / space.scale).reshape(3, -1).T.astype(float)
    gap = ((new - space.mean) / space.scale).ravel()
    expected = np.linalg.lstsq(basis, gap, rcond=None)[0]
    np.testing.assert_allclose(space.coefficients(new), expected, atol=1e-4)


def test_a_coordinate_without_variance_stays_where_it_is(garments):
    still = garments.copy()
    still[:, 5, 1] = 0.3
    space = fit_space(still, 2, FACES)
    wild = space.vertices(np.full(2, 3.0))
    assert wild[5, 1] == pytest.approx(0.3)
    assert np.isfinite(space.coefficients(garments)).all()


def test_the_order_of_the_garments_does_not_matter(garments):
    first = fit_space(garments, 3, FACES)
    second = fit_space(garments[::-1], 3, FACES)
    np.testing.assert_allclose(first.components, second.components, atol=1e-6)


def test_a_space_survives_its_file(tmp_path, garments):
    space = fit_space(garments, 3, FACES)
    space.save(tmp_path / "space.npz")
    loaded = load_space(tmp_path / "space.npz")
    for name in ("faces", "mean", "components", "explained", "scale"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(space, name))


def test_one_garment_makes_no_space(garments):
    with pytest.raises(InputError, match="1 training garments make no shape space"):
        fit_space(garments[:1], 4, FACES)


def test_a_garment_that_is_not_finite_is_named(garments):
    broken = garments.copy()
    broken[7, 3, 0] = np.nan
    with pytest.raises(InputError, match="training garment 7 is not finite"):
        fit_space(broken, 4, FACES)
