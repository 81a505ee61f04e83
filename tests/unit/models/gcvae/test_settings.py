"""Settings of the garment VAEs from nested mappings."""

import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.settings import DvaeSettings, GcvaeTraining, VaeSettings
from toys.gcvae_files import SETTINGS


def test_settings_survive_a_checkpoint_whose_values_are_plain():
    settings = SETTINGS.replace(training=GcvaeTraining(epochs=3, mask=False, version="posed"))
    stored = settings.plain()
    assert isinstance(stored["network"]["widths"], list)
    assert VaeSettings(**stored) == settings


def test_what_is_not_named_has_the_default_of_its_place():
    given = {"network": {"latent": 7}, "training": {"seed": 4}}
    for default in (VaeSettings(), DvaeSettings()):
        settings = type(default)(**given)
        assert settings.network == default.network.replace(latent=7)
        assert settings.loss == default.loss
        assert settings.training == default.training.replace(seed=4)
    assert DvaeSettings(**given).training.epochs != VaeSettings(**given).training.epochs


def test_a_setting_that_does_not_exist_or_is_out_of_range_is_named():
    with pytest.raises(InputError, match="GcvaeTraining: 'momentum' is not a setting"):
        VaeSettings(training={"momentum": 0.9})
    with pytest.raises(InputError, match="GcvaeLoss: normals is -1, expected a number from 0 to"):
        VaeSettings(loss={"normals": -1})
