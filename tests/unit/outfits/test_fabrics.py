from dataclasses import asdict

import pytest

from drapeline.outfits.fabrics import FABRICS, fabric_names


def test_upper_garments_are_of_cotton_or_silk_as_in_the_paper():
    assert fabric_names(upper=True) == ("cotton", "silk")
    assert fabric_names(upper=False) == ("cotton", "silk", "denim", "leather")


@pytest.mark.parametrize("name", FABRICS)
def test_every_fabric_weighs_resists_and_bends(name):
    values = asdict(FABRICS[name])
    for value in ("density_kg_m2", "stretch_n_per_m", "bending_n_m", "drag_kg_m2_s"):
        assert values[value] > 0
    assert values["damping_kg_s"] >= 0


def test_silk_is_the_lightest_and_limpest_and_leather_the_stiffest():
    by_weight = sorted(FABRICS, key=lambda name: FABRICS[name].density_kg_m2)
    by_bending = sorted(FABRICS, key=lambda name: FABRICS[name].bending_n_m)
    assert by_weight == ["silk", "cotton", "leather", "denim"]
    assert by_bending == ["silk", "cotton", "denim", "leather"]
