from dataclasses import asdict

import pytest

from drapeline.outfits.fabrics import (
    CLOTH3D_FABRICS,
    FABRICS,
    MEASURED_FABRICS,
    cloth3d_name,
    fabrics_of,
)
from drapeline.outfits.garment_types import GARMENTS

PRESETS = tuple(name for name in FABRICS if name.startswith("blender_"))


def test_blenders_presets_make_garments_as_in_the_paper():
    assert set(PRESETS) == set(FABRICS) - set(MEASURED_FABRICS)
    for shirt in ("Tshirt", "Top"):
        assert fabrics_of(shirt, PRESETS) == ["blender_cotton", "blender_silk"]
    for garment in ("Trousers", "Skirt", "Jumpsuit", "Dress"):
        assert fabrics_of(garment, PRESETS) == list(PRESETS)


@pytest.mark.parametrize("garment", GARMENTS)
def test_every_garment_can_be_made_of_several_measured_fabrics(garment):
    assert len(fabrics_of(garment, MEASURED_FABRICS)) > 3


def test_no_shirt_is_of_denim_or_leather():
    assert not {"denim", "leather"} & set(fabrics_of("Tshirt", FABRICS))


@pytest.mark.parametrize("name", FABRICS)
def test_every_fabric_has_a_word_of_cloth3ds(name):
    assert cloth3d_name(name) in CLOTH3D_FABRICS


@pytest.mark.parametrize("name", FABRICS)
def test_every_fabric_weighs_resists_and_bends(name):
    values = asdict(FABRICS[name])
    for key in ("cloth3d", "garments", "damping_kg_s"):
        assert values.pop(key) or key == "damping_kg_s"
    assert all(value > 0 for value in values.values())


@pytest.mark.parametrize("name", MEASURED_FABRICS)
def test_cloth_is_stiffest_along_its_warp_and_limp_on_the_bias(name):
    fabric = FABRICS[name]
    assert fabric.stretch_warp_n_per_m >= fabric.stretch_weft_n_per_m > fabric.shear_n_per_m
    assert fabric.bending_warp_n_m >= fabric.bending_weft_n_m
