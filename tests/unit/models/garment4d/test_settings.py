"""Settings from plain values."""

import json
from dataclasses import replace

import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.training.checkpoints import read_checkpoint
from toys.garment4d import PLAIN


def test_settings_come_from_plain_values_and_go_back(trained_canonical):
    about = read_checkpoint(trained_canonical / "best.ckpt")["drapeline"]
    settings = CanonicalStage.parse(about["settings"])
    assert settings == CanonicalStage.parse(PLAIN)
    assert json.loads((trained_canonical / "settings.json").read_text())["loss"] == {
        **about["settings"]["loss"]
    }
    assert settings.training == replace(settings.training, sources=("simulated", "skinned"))
    scaled = CanonicalStage.parse({"network": {"points": 1000, "width": 0.25}}).network
    assert scaled.garment[0].widths[0] == (8, 8)
    for given, points in ((None, 250), (700, 700)):
        values = {"points": 1000, "width": 1.0, "garment_points": given}
        assert CanonicalStage.parse({"network": values}).network.garment_points == points


def test_unknown_settings_are_refused():
    with pytest.raises(InputError, match="CanonicalWeights: no setting 'laplace', expected one of"):
        CanonicalStage.parse({"loss": {"laplace": 1.0}})
