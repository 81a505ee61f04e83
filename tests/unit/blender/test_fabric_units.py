import pytest

from drapeline.blender.fabric_units import UNIT_EDGE_M, cloth_parameters
from drapeline.outfits.fabrics import FABRICS


def test_at_one_centimetre_the_settings_are_blenders_own_presets():
    """Mass, tension, bending and damping as in `cotton` and `denim` of Blender 4.5."""
    for name, preset in {"cotton": (0.3, 15, 0.5, 5), "denim": (1.0, 40, 10, 25)}.items():
        settings = cloth_parameters(FABRICS[name], UNIT_EDGE_M)
        found = (settings.mass, settings.tension_stiffness, settings.bending_stiffness)
        assert (*found, settings.tension_damping) == preset
        assert (settings.air_damping, settings.bending_damping) == (1, 0.5)


@pytest.mark.parametrize("edge_m", [0.005, 0.014, 0.04])
def test_the_cloth_is_the_same_at_every_resolution(edge_m):
    fabric = FABRICS["cotton"]
    one, other = cloth_parameters(fabric, 0.01), cloth_parameters(fabric, edge_m)
    # What a square metre weighs, pulls with and feels of the air.
    assert other.mass / edge_m**2 == pytest.approx(one.mass / 0.01**2)
    assert other.tension_stiffness / edge_m == pytest.approx(one.tension_stiffness / 0.01)
    assert other.bending_stiffness * edge_m == pytest.approx(one.bending_stiffness * 0.01)
    assert other.air_damping / other.mass == pytest.approx(one.air_damping / one.mass)
