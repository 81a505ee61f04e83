import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.codec import encode_garments
from drapeline.models.gcvae.load import (
    TOPOLOGY,
    TRAINING_CODES,
    load_training_codes,
    mask_rates,
    save_static_files,
)
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import load_topology
from toys.gcvae import VERTICES, toy_template, tube_faces
from toys.gcvae_files import SETTINGS, save_model, toy_topology


def test_the_codes_are_those_of_training_garments_by_the_best_weights(tmp_path, model, garments):
    save_model(tmp_path / "model", model)
    last = StaticVae(SETTINGS, toy_template())  # other weights than those of the checkpoint
    save_static_files(tmp_path / "model", last, garments, toy_topology())
    codes, garment, rate = load_training_codes(tmp_path / "model")
    train = garments.rows("train")
    wanted = encode_garments(model, garments, train)
    for part, again in zip(wanted, codes, strict=True):
        np.testing.assert_allclose(again, part, atol=1e-5)
    np.testing.assert_array_equal(garment, garments.garment[train])
    for index in range(len(GARMENTS)):
        own = garments.mask[train][garment == index]
        np.testing.assert_allclose(rate[index], own.mean(axis=0) if len(own) else 0, atol=1e-6)
    topology = load_topology(tmp_path / "model" / TOPOLOGY)
    np.testing.assert_array_equal(topology.skirt_faces, tube_faces(True))


def test_a_type_without_garments_covers_nothing():
    mask = np.ones((2, VERTICES), dtype=bool)
    mask[1, 0] = False
    rates = mask_rates(np.array([3, 3]), mask, np.arange(2))
    assert rates[3, 0] == 0.5
    assert rates[3].sum() == VERTICES - 0.5
    assert not np.delete(rates, 3, axis=0).any()


def test_a_folder_of_an_earlier_version_is_named(tmp_path, model):
    save_model(tmp_path / "model", model)
    with pytest.raises(InputError, match=f"{TRAINING_CODES}: no such file, expected an .npz with"):
        load_training_codes(tmp_path / "model")
