"""Trained networks and fitted PCA from their checkpoints."""

import pytest
import torch

from drapeline.errors import DamagedFile, InputError
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.ppca import DynamicPpca, StaticPpca
from drapeline.models.gcvae.settings import DvaeSettings, PpcaSettings
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from toys.gcvae import toy_template
from toys.gcvae_files import SETTINGS, save_model, shaken

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
