"""The models of the ablation tables."""

from drapeline.models.gcvae.settings import (
    DVAE_VARIANTS,
    DYNAMIC_PPCA,
    SVAE_VARIANTS,
    dynamic_conditions,
)
from drapeline.models.training.settings import override_settings


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
