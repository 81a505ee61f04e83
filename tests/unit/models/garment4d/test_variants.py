import pytest

from drapeline.models.garment4d.settings import POSED_VARIANTS, posed_variants
from drapeline.models.garment4d.stages import PosedStage
from drapeline.models.training.settings import override_settings
from toys.garment4d import POSED


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
