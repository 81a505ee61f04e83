"""Settings from plain values."""

import json

import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.settings import CanonicalSettings, CanonicalStageSettings
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.garment4d import PLAIN


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
