import numpy as np
import pytest

from drapeline.models.gcvae.codec import (
    Codes,
    encode_garments,
    encode_held_out,
    join_codes,
    load_codes,
    save_codes,
)
from drapeline.seeding import rng_for


def test_codes_do_not_depend_on_the_batch(model, garments):
    rows = np.arange(40)
    codes = encode_garments(model, garments, rows)
    some = encode_garments(model, garments, rows[[30, 3, 17]])
    np.testing.assert_allclose(some.mean, codes.mean[[30, 3, 17]], atol=1e-5)
    assert codes.log_variance.shape == (40, 5)


def test_codes_of_training_rows_are_taken_over_and_all_others_computed(model, garments):
    everything = encode_garments(model, garments, np.arange(len(garments.split)))
    train = garments.rows("train")
    known = Codes(everything.mean[train] + 1, everything.log_variance[train])
    found = encode_held_out(model, garments, known)
    held_out = garments.split != "train"
    assert held_out.any()
    np.testing.assert_array_equal(found.mean[train], known.mean)
    np.testing.assert_allclose(found.mean[held_out], everything.mean[held_out], atol=1e-5)
    assert found.log_variance.shape == everything.log_variance.shape


def test_codes_can_be_saved_with_what_they_are_of(garments, tmp_path):
    rng = rng_for(0, "codes")
    codes = Codes(*rng.normal(size=(2, 48, 5)).astype(np.float32))
    save_codes(tmp_path / "codes.npz", codes, garments)
    loaded, about = load_codes(tmp_path / "codes.npz")
    for part, again in zip(codes, loaded, strict=True):
        np.testing.assert_array_equal(part, again)
    for name in ("garment", "outfit", "split"):
        np.testing.assert_array_equal(about[name], getattr(garments, name))
    np.testing.assert_array_equal(loaded.of(np.array([3, 1])).mean, codes.mean[[3, 1]])


def test_the_kl_of_a_code_is_summed_over_its_numbers():
    mean, variance = np.float32([[1, 0, 2]]), np.float32([[1, 0.5, 1]])
    by_hand = 0.5 * (1 + 4 + (0.5 - 1 - np.log(0.5)))
    assert Codes(mean, np.log(variance)).kl_nat() == pytest.approx([by_hand])


def test_active_units_are_those_whose_means_vary():
    """Three numbers: one varies, one does so too little, one is the same for all."""
    mean = np.stack([np.array([-1.0, 1.0]), np.array([-0.09, 0.09]), np.array([5.0, 5.0])], 1)
    codes = Codes(mean, np.zeros((2, 3)))
    assert codes.active_units() == 1
    joined = join_codes([codes, Codes(mean[:, [1, 0, 2]], np.zeros((2, 3)))])
    assert joined.mean.shape == (4, 3)
    assert joined.active_units() == 2
