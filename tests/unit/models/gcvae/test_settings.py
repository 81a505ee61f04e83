"""Settings of the garment VAEs from nested mappings."""

from dataclasses import asdict, replace

import pytest

from drapeline.models.gcvae.settings import GcvaeTraining, VaeSettings
from drapeline.models.training.module import plain
from toys.gcvae_files import SETTINGS


def test_settings_survive_a_checkpoint_whose_values_are_plain():
    settings = replace(SETTINGS, training=GcvaeTraining(epochs=3, mask=False, version="posed"))
    stored = plain(asdict(settings))
    assert isinstance(stored["network"]["widths"], list)
    assert VaeSettings.of(stored) == settings


def test_what_is_not_named_has_its_default():
    settings = VaeSettings.of({"network": {"latent": 7}, "loss": {}, "training": {"seed": 4}})
    default = VaeSettings()
    assert settings.network == replace(default.network, latent=7)
    assert settings.loss == default.loss
    assert settings.training == replace(default.training, seed=4)


def test_a_setting_that_does_not_exist_is_an_error():
    with pytest.raises(TypeError, match="momentum"):
        VaeSettings.of({"network": {}, "loss": {}, "training": {"momentum": 0.9}})
