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

CVAR = np.zeros(13)


def training(codes, garment, cvar):
    return TrainingCodes(codes, garment, cvar, np.ones((len(GARMENTS), VERTICES)))


def likeliest(types, codes, masks):
    return [
        int(types.log_likelihood(*one, CVAR).argmax()) for one in zip(codes, masks, strict=True)
    ]


def test_codes_are_drawn_where_their_type_is(types):
    rng = rng_for(1, "draws")
    for name in ("Dress", "Trousers"):
        index = GARMENTS.index(name)
        at = types.conditions[index]
        drawn = np.stack([types.draw(rng, name, at) for _ in range(300)])
        np.testing.assert_allclose(drawn.mean(0), types.mean[index], atol=0.15)
        np.testing.assert_allclose(drawn.std(0), 0.5, atol=0.1)
    assert types.share[[DRESS, TROUSERS]].tolist() == [0.5, 0.5]


def test_codes_are_drawn_near_those_of_garments():
    """Two kinds of dresses: few are drawn between them, where their Gaussian has its mode."""
    rng = rng_for(0, "two kinds")
    mean = rng.normal(size=(200, 5))
    mean[:, 0] = np.repeat([-3.0, 3.0], 100)
    garment = np.full(200, DRESS)
    codes = Codes(mean, np.full((200, 5), -6.0))
    types = fit_types(training(codes, garment, np.zeros((200, 2))))
    drawn = np.stack([types.draw(rng, "Dress", np.zeros(2)) for _ in range(1000)])
    assert (np.abs(drawn[:, 0]) < 0.5).mean() < 0.09  # of the Gaussian's 0.12
    np.testing.assert_allclose(drawn.std(0), mean.std(0), rtol=0.15)


def test_codes_of_one_kind_are_drawn_as_widely_as_a_gaussian():
    """Where garments have nothing in common but their Gaussian, copies of them are no likelier."""
    rng = rng_for(0, "one kind")
    codes = Codes(rng.normal(size=(300, 40)), np.full((300, 40), -6.0))
    assert fit_types(training(codes, np.full(300, DRESS), np.zeros((300, 1)))).bandwidth >= 0.8


def test_codes_follow_the_conditions_as_far_as_garments_do():
    rng = rng_for(0, "conditions")
    cvar = rng.normal(size=(400, 3)) * [1.0, 5.0, 0.0] + [0, 2, 7]
    garment = np.repeat([DRESS, TROUSERS], 200)
    slope = np.where(garment == DRESS, 2.0, -1.0)
    mean = rng.normal(size=(400, 4)) * 0.1
    mean[:, 0] += slope * cvar[:, 1]
    types = fit_types(training(Codes(mean, np.full((400, 4), -6.0)), garment, cvar))
    for name, index, rise in (("Dress", DRESS, 2.0), ("Trousers", TROUSERS, -1.0)):
        low, high = (types.expected(np.array([0, y, 7.0]))[index] for y in (-3.0, 7.0))
        np.testing.assert_allclose(high - low, [10 * rise, 0, 0, 0], atol=3.0)
        drawn = np.stack([types.draw(rng, name, np.array([0, 7.0, 7.0])) for _ in range(200)])
        np.testing.assert_allclose(drawn.mean(0), high, atol=0.3)
        assert drawn[:, 0].std() < 2
    between = types.expected(np.array([0, 7.0, 7.0]))[DRESS]
    masks = np.ones((len(GARMENTS), VERTICES), dtype=bool)
    assert types.log_likelihood(between, masks, np.array([0, 7.0, 7.0])).argmax() == DRESS


def test_a_type_without_garments_is_refused_and_never_found(types):
    with pytest.raises(InputError, match="no training garment is a Top, expected one of Trousers"):
        types.draw(rng_for(0, "draws"), "Top", CVAR)
    rng = rng_for(0, "anything")
    masks = rng.random((50, len(GARMENTS), VERTICES)) < 0.5
    codes = 10 * rng.normal(size=(50, 5))
    assert set(likeliest(types, codes, masks)) == {DRESS, TROUSERS}


def test_types_are_told_by_code_where_masks_agree_and_by_mask_where_codes_do(types):
    noise = rng_for(0, "noise").random((20, len(GARMENTS), VERTICES)) < 0.2
    between = np.zeros((20, 5))
    for upper, expected in ((True, DRESS), (False, TROUSERS)):
        assert set(likeliest(types, between, half(upper) ^ noise)) == {expected}
        assert set(likeliest(types, np.tile(types.mean[expected], (20, 1)), noise)) == {expected}


def test_types_are_estimated_from_the_training_codes_of_a_folder(tmp_path, garments):
    save_model(tmp_path / "model", garments=garments)
    saved, types = load_training_codes(tmp_path / "model"), load_types(tmp_path / "model")
    for index in np.unique(saved.garment):
        own = saved.garment == index
        assert types.share[index] == pytest.approx(own.mean())
        np.testing.assert_allclose(types.mean[index], saved.codes.mean[own].mean(axis=0), rtol=1e-5)
