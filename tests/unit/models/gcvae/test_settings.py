"""Settings of the garment VAEs, and the models of the ablation tables."""

import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.settings import (
    DVAE_VARIANTS,
    DYNAMIC_PPCA,
    SVAE_VARIANTS,
    DvaeSettings,
    GcvaeTraining,
    VaeSettings,
    dynamic_conditions,
)
from drapeline.models.training.settings import override_settings
from toys.gcvae_files import SETTINGS


def test_settings_survive_a_checkpoint_whose_values_are_plain():
    settings = SETTINGS.replace(training=GcvaeTraining(steps=3, mask=False, version="posed"))
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
    assert DvaeSettings(**given).training.steps != VaeSettings(**given).training.steps


def test_a_setting_that_does_not_exist_or_is_out_of_range_is_named():
    with pytest.raises(InputError, match="GcvaeTraining: 'momentum' is not a setting"):
        VaeSettings(training={"momentum": 0.9})
    with pytest.raises(InputError, match="GcvaeLoss: normals is -1, expected a number from 0 to"):
        VaeSettings(loss={"normals": -1})


def test_dynamic_variants_tell_their_offsets_and_frames():
    assert dynamic_conditions("dvae_posed_1") == ("posed", 1)
    assert dynamic_conditions(DYNAMIC_PPCA) == ("unposed", 4)
    for variant, changes in DVAE_VARIANTS.items():
        assert changes["training"]["version"] == dynamic_conditions(variant)[0]


def test_variants_change_what_their_rows_of_the_table_say():
    full = {"network": {"scale": 1}, "loss": {"normals": 70.0}, "training": {"mask": True}}
    assert override_settings(full, SVAE_VARIANTS["svae"]) == full
    assert override_settings(full, SVAE_VARIANTS["svae_no_normals"])["loss"]["normals"] == 0
    assert not override_settings(full, SVAE_VARIANTS["svae_no_mask"])["training"]["mask"]
    for changes in DVAE_VARIANTS.values():
        changed = override_settings(full, changes)
        assert changed["network"]["scale"] == 2
        assert not changed["training"]["mask"]
