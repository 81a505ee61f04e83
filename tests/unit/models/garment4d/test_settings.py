"""Settings and variants."""

import json

import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.settings import (
    POSED_VARIANTS,
    CanonicalSettings,
    CanonicalStageSettings,
    posed_variants,
)
from drapeline.models.garment4d.stages import PosedStage
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.models.training.settings import override_settings
from toys.garment4d import PLAIN, POSED


def test_settings_come_from_plain_values_and_go_back(trained_canonical):
    found = read_checkpoint(trained_canonical / BEST).metadata["settings"]
    settings = CanonicalStageSettings(**found)
    assert settings == CanonicalStageSettings(**PLAIN)
    assert json.loads((trained_canonical / "settings.json").read_text())["loss"] == {
        **found["loss"]
    }
    assert settings.training.sources == ("simulated", "skinned")


def test_the_released_network_is_scaled_to_clouds_and_width():
    scaled = CanonicalSettings(points=1000, width=0.25).scaled_layers()
    assert scaled.garment[0].widths[0] == (8, 8)
    for given, points in ((None, 250), (700, 700)):
        settings = CanonicalSettings(points=1000, width=1.0, garment_points=given)
        assert settings.scaled_layers().garment_points == points


def test_unknown_settings_are_refused():
    with pytest.raises(InputError, match="CanonicalWeights: 'laplace' is not a setting, did you"):
        CanonicalStageSettings(loss={"laplace": 1.0})


@pytest.mark.parametrize("name", POSED_VARIANTS)
def test_variants_change_settings_that_there_are(name):
    settings = {"network": {}, "skinning": {}, **POSED}
    changed = PosedStage.SETTINGS(**override_settings(settings, POSED_VARIANTS[name]))
    for group, values in POSED_VARIANTS[name].items():
        for key, value in values.items():
            assert getattr(getattr(changed, group), key) == value


def test_what_an_experiment_has_anyway_is_no_variant_of_it():
    plain = {
        "network": {"pull_neighbours": 0, "smooth_passes": 0, "transformer": "paper"},
        "loss": {"interpenetration": 100.0},
    }
    assert "as_printed" not in posed_variants(plain)
    smoothed = {"network": {**plain["network"], "smooth_passes": 8}}
    assert posed_variants(smoothed) == POSED_VARIANTS
    assert posed_variants(plain).keys() == POSED_VARIANTS.keys() - {"as_printed"}
