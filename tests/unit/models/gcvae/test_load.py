"""Trained networks, fitted PCA and what lies beside them, from their files."""

import numpy as np
import pytest
import torch

from drapeline.errors import DamagedFile, InputError
from drapeline.models.gcvae.codec import encode_garments
from drapeline.models.gcvae.load import (
    TOPOLOGY,
    TRAINING_CODES,
    load_codec,
    load_training_codes,
    mask_rates,
    save_static_files,
)
from drapeline.models.gcvae.ppca import DynamicPpca, StaticPpca
from drapeline.models.gcvae.settings import DvaeSettings, PpcaSettings
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import load_topology
from toys.gcvae import VERTICES, toy_template, tube_faces
from toys.gcvae_files import SETTINGS, save_model, shaken, toy_topology

MOVING = DvaeSettings(**SETTINGS.replace(training={"mask": False, "version": "unposed"}).plain())


@pytest.mark.parametrize(
    ("cls", "settings"),
    [
        (StaticVae, SETTINGS),
        (DynamicVae, MOVING),
        (StaticPpca, PpcaSettings(latent=5)),
        (DynamicPpca, PpcaSettings(latent=5, seed=3)),
    ],
)
def test_a_network_comes_back_with_its_class_settings_and_weights(tmp_path, cls, settings):
    saved = save_model(tmp_path / "model", shaken(cls(settings, toy_template())))
    loaded = load_codec(tmp_path / "model" / BEST)
    assert type(loaded) is cls
    assert loaded.settings == settings
    assert not loaded.training
    for key, value in saved.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[key], value, rtol=0, atol=0)
    for key, value in saved.body_template.tensors().items():
        torch.testing.assert_close(loaded.body_template.tensors()[key], value)


def test_a_checkpoint_of_another_network_is_refused(tmp_path):
    write_checkpoint(tmp_path / BEST, {}, {"checkpoint_type": "conditioning"})
    with pytest.raises(InputError, match=rf"{BEST}: holds a 'conditioning' network, expected"):
        load_codec(tmp_path / BEST)


def test_a_checkpoint_whose_graphs_lack_their_levels_is_refused(tmp_path):
    save_model(tmp_path / "model", StaticPpca(PpcaSettings(latent=5), toy_template()))
    path = tmp_path / "model" / BEST
    saved = read_checkpoint(path)
    template = saved.metadata["body_template"]
    for key in [key for key in template if key.startswith(("edges/body", "parents/body"))]:
        del template[key]
    write_checkpoint(path, *saved)
    with pytest.raises(DamagedFile, match=rf"{BEST}: .*'edges/body' has 0 levels, expected two"):
        load_codec(path)


@pytest.mark.parametrize("name", ["parents/body/0", "edges/body/1", "faces/skirt"])
def test_a_checkpoint_whose_graphs_name_nodes_that_are_not_there_is_refused(tmp_path, name):
    save_model(tmp_path / "model", StaticPpca(PpcaSettings(latent=5), toy_template()))
    path = tmp_path / "model" / BEST
    saved = read_checkpoint(path)
    saved.metadata["body_template"][name].view(-1)[0] = 2_000_000_000
    write_checkpoint(path, *saved)
    with pytest.raises(DamagedFile, match=rf"{BEST}: .*'{name}' names number 2000000000"):
        load_codec(path)


def test_the_codes_are_those_of_training_garments_by_the_best_weights(tmp_path, model, garments):
    save_model(tmp_path / "model", model)
    last = StaticVae(SETTINGS, toy_template())  # other weights than those of the checkpoint
    save_static_files(tmp_path / "model", last, garments, toy_topology())
    codes, garment, cvar, rate = load_training_codes(tmp_path / "model")
    train = garments.rows("train")
    wanted = encode_garments(model, garments, train)
    for part, again in zip(wanted, codes, strict=True):
        np.testing.assert_allclose(again, part, atol=1e-5)
    np.testing.assert_array_equal(garment, garments.garment[train])
    np.testing.assert_array_equal(cvar, garments.cvar(train))
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
