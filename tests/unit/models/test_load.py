import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.gcvae.settings import DvaeSettings
from drapeline.models.gcvae.static_model import StaticModel
from drapeline.models.gcvae.vae import DynamicVae
from drapeline.models.load import load
from drapeline.models.training.module import BEST
from toys.gcvae import toy_template
from toys.gcvae_files import SETTINGS, TypedGarments, save_model, shaken


class Opened:
    """Does something when it is unpickled."""

    def __reduce__(self):
        return print, ("executed",)


def test_a_static_model_is_told_by_its_checkpoint(tmp_path):
    save_model(tmp_path / "svae", garments=TypedGarments())
    model = load(tmp_path / "svae")
    assert isinstance(model, StaticModel)
    assert model.latent == SETTINGS.network.latent


def test_a_model_of_garments_in_motion_is_refused(tmp_path):
    moving = SETTINGS.replace(training={"mask": False, "version": "posed"})
    settings = DvaeSettings(**moving.plain())
    save_model(tmp_path / "dvae", shaken(DynamicVae(settings, toy_template())))
    with pytest.raises(InputError, match=rf"{BEST}: holds a 'dynamic' network, expected static"):
        load(tmp_path / "dvae")
    with pytest.raises(InputError, match="a model of garments in motion, expected one of garments"):
        StaticModel(tmp_path / "dvae")


def test_a_folder_that_is_missing_or_without_a_model_is_named(tmp_path):
    with pytest.raises(InputError, match="nothing: no such folder, expected that of a trained mod"):
        load(tmp_path / "nothing")
    (tmp_path / "nothing").mkdir()
    with pytest.raises(InputError, match=rf"nothing/{BEST}: no such file, expected a checkpoin"):
        load(tmp_path / "nothing")


def test_nothing_in_a_checkpoint_is_executed(tmp_path, capsys):
    torch.save({"drapeline": Opened()}, tmp_path / BEST)
    with pytest.raises(InputError, match="not readable as a checkpoint in safetensors"):
        load(tmp_path)
    assert "executed" not in capsys.readouterr().out
