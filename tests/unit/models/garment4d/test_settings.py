"""Settings and variants."""

import json

import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.settings import (
    MGN_VARIANTS,
    POSED_VARIANTS,
    CanonicalSettings,
    CanonicalStageSettings,
    LabelStageSettings,
    SegmentationSettings,
    posed_variants,
)
from drapeline.models.garment4d.stages import MgnStage, PosedStage
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.models.training.settings import override_settings
from toys.garment4d import CANONICAL, LABELLING, POSED


def test_settings_come_from_plain_values_and_go_back(trained_canonical):
    found = read_checkpoint(trained_canonical / BEST).metadata["settings"]
    settings = CanonicalStageSettings(**found)
    assert settings == CanonicalStageSettings(**CANONICAL)
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


@pytest.mark.parametrize(
    ("cls", "name", "changes"),
    [
        *((PosedStage, name, changes) for name, changes in POSED_VARIANTS.items()),
        *((MgnStage, name, changes) for name, changes in MGN_VARIANTS.items()),
    ],
)
def test_variants_change_settings_that_there_are(cls, name, changes):
    settings = {"skinning": {}, **POSED, "network": {}}
    changed = cls.SETTINGS(**override_settings(settings, changes))
    for group, values in changes.items():
        for key, value in values.items():
            assert getattr(getattr(changed, group), key) == value


def test_what_an_experiment_has_anyway_is_no_variant_of_it():
    plain = {
        "network": {"pull_neighbours": 0, "smooth_passes": 0, "transformer": "paper"},
        "loss": {"interpenetration": 100.0},
    }
    assert posed_variants(plain) == POSED_VARIANTS
    for changed, same in (
        ({"network": {"pull_neighbours": 4, "smooth_passes": 8}}, {"pulled"}),
        ({"network": {"pull_neighbours": 4}}, set()),
        ({"network": {"transformer": "none"}}, {"no_transformer"}),
        ({"skinning": {"neighbours": 1, "passes": 0}}, {"nearest_weights"}),
    ):
        values = override_settings({"skinning": {}, **plain}, changed)
        assert posed_variants(values).keys() == POSED_VARIANTS.keys() - same


def test_our_labels_depart_from_the_canonical_stage_in_what_is_theirs_alone():
    given = {"points": 1000, "width": 0.5}
    labels, canonical = SegmentationSettings(**given), CanonicalSettings(**given)
    assert labels.scaled_layers() == canonical.scaled_layers()
    with pytest.raises(InputError, match="'garment_points' is not a setting"):
        SegmentationSettings(garment_points=700)
    settings = LabelStageSettings(**LABELLING)
    assert LabelStageSettings(**settings.plain()) == settings
