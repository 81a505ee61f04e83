import pytest

from drapeline.outfits.fabrics import FABRICS, PRESET_EDGE_M, cloth_parameters


@pytest.mark.parametrize("name", FABRICS)
def test_at_the_presets_edge_length_the_settings_are_the_preset(name):
    fabric = FABRICS[name]
    settings = cloth_parameters(fabric, PRESET_EDGE_M)
    assert settings.mass == pytest.approx(fabric.density_kg_m2)
    assert settings.tension_stiffness == pytest.approx(fabric.stretch)
    assert settings.bending_stiffness == pytest.approx(fabric.bending)
    assert settings.air_damping == pytest.approx(fabric.air)


@pytest.mark.parametrize("edge_m", [0.005, 0.014, 0.04])
def test_the_cloth_is_the_same_at_every_resolution(edge_m):
    fabric = FABRICS["cotton"]
    one, other = cloth_parameters(fabric, 0.01), cloth_parameters(fabric, edge_m)
    # What a square metre weighs, pulls with, bends with and feels of the air.
    assert other.mass / edge_m**2 == pytest.approx(one.mass / 0.01**2)
    assert other.tension_stiffness / edge_m == pytest.approx(one.tension_stiffness / 0.01)
    assert other.bending_stiffness * edge_m == pytest.approx(one.bending_stiffness * 0.01)
    assert other.air_damping / other.mass == pytest.approx(one.air_damping / one.mass)
