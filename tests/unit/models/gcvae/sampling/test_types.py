import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.codes import Codes
from drapeline.models.gcvae.sampling.types import fit_training_types, fit_types
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from gcvae_toys import DRESS, TROUSERS, VERTICES, half


def test_codes_are_drawn_where_their_type_is(types):
    rng = rng_for(1, "draws")
    for name in ("Dress", "Trousers"):
        drawn = np.stack([types.draw(rng, name) for _ in range(300)])
        np.testing.assert_allclose(drawn.mean(0), types.mean[GARMENTS.index(name)], atol=0.15)
        np.testing.assert_allclose(drawn.std(0), 0.5, atol=0.1)
    assert types.share[[DRESS, TROUSERS]].tolist() == [0.5, 0.5]


def test_codes_are_drawn_near_those_of_garments():
    """Two kinds of dresses: none is drawn between them, where their Gaussian has its mode."""
    rng = rng_for(0, "two kinds")
    mean = rng.normal(size=(200, 5))
    mean[:, 0] = np.repeat([-3.0, 3.0], 100)
    garment = np.full(200, DRESS)
    types = fit_types(Codes(mean, np.full((200, 5), -6.0)), garment, np.ones((200, VERTICES), bool))
    drawn = np.stack([types.draw(rng, "Dress") for _ in range(1000)])
    assert (np.abs(drawn[:, 0]) < 0.5).mean() < 0.06
    np.testing.assert_allclose(drawn.std(0), mean.std(0), rtol=0.15)


def test_a_type_without_garments_is_refused_and_never_found(types):
    with pytest.raises(InputError, match="no training garment is a Top, expected one of Trousers"):
        types.draw(rng_for(0, "draws"), "Top")
    rng = rng_for(0, "anything")
    masks = rng.random((50, len(GARMENTS), VERTICES)) < 0.5
    found = types.log_likelihood(10 * rng.normal(size=(50, 5)), masks).argmax(axis=1)
    assert set(found) == {DRESS, TROUSERS}


def test_types_are_told_by_code_where_masks_agree_and_by_mask_where_codes_do(types):
    noise = rng_for(0, "noise").random((20, len(GARMENTS), VERTICES)) < 0.2
    between = np.zeros((20, 5))
    for upper, expected in ((True, DRESS), (False, TROUSERS)):
        found = types.log_likelihood(between, half(upper) ^ noise).argmax(axis=1)
        assert (found == expected).all()
        found = types.log_likelihood(np.tile(types.mean[expected], (20, 1)), noise).argmax(axis=1)
        assert (found == expected).all()


def test_types_are_estimated_from_training_rows_alone(garments):
    rng = rng_for(0, "codes")
    codes = Codes(rng.normal(size=(48, 5)), np.full((48, 5), -6.0))
    types = fit_training_types(codes, garments)
    train = garments.rows("train")
    np.testing.assert_array_equal(types.codes, codes.mean[train])
    for garment_index in np.unique(garments.garment[train]):
        own = train[garments.garment[train] == garment_index]
        assert types.share[garment_index] == pytest.approx(len(own) / len(train))
        np.testing.assert_allclose(types.mean[garment_index], codes.mean[own].mean(axis=0))
        np.testing.assert_allclose(types.mask_rate[garment_index], garments.mask[own].mean(axis=0))
