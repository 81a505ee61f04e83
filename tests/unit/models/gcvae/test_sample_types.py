import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.codec import Codes
from drapeline.models.gcvae.load import TrainingCodes, load_training_codes
from drapeline.models.gcvae.sample import fit_types, load_types
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from toys.gcvae import DRESS, TROUSERS, VERTICES, half
from toys.gcvae_files import save_model


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
    codes = Codes(mean, np.full((200, 5), -6.0))
    types = fit_types(TrainingCodes(codes, garment, np.ones((len(GARMENTS), VERTICES))))
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


def test_types_are_estimated_from_the_training_codes_of_a_folder(tmp_path, garments):
    save_model(tmp_path / "model", garments=garments)
    training, types = load_training_codes(tmp_path / "model"), load_types(tmp_path / "model")
    np.testing.assert_array_equal(types.codes, training.codes.mean)
    for index in np.unique(training.garment):
        own = training.garment == index
        assert types.share[index] == pytest.approx(own.mean())
        np.testing.assert_allclose(
            types.mean[index], training.codes.mean[own].mean(axis=0), rtol=1e-5
        )
