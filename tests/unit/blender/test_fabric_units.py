from dataclasses import replace

import numpy as np
import pytest

from drapeline.blender.fabric_units import UNIT_EDGE_M, cloth_parameters
from drapeline.frames import FPS
from drapeline.outfits.fabrics import FABRICS
from toys.sheets import sheet

COLUMNS = 5


def test_at_one_centimetre_the_settings_are_blenders_own_presets():
    """Mass, tension, bending and damping as in `cotton` and `denim` of Blender 4.5."""
    for name, preset in {"cotton": (0.3, 15, 0.5, 5), "denim": (1.0, 40, 10, 25)}.items():
        settings = cloth_parameters(FABRICS[f"blender_{name}"], UNIT_EDGE_M)
        found = (settings.mass, settings.tension_stiffness, settings.bending_stiffness)
        assert (*found, settings.tension_damping) == pytest.approx(preset)
        assert settings.compression_stiffness == pytest.approx(preset[1])
        assert settings.shear_stiffness == pytest.approx(preset[1])
        assert (settings.air_damping, settings.bending_damping) == (1, 0.5)


@pytest.mark.parametrize("edge_m", [0.005, 0.014, 0.04])
def test_the_cloth_is_the_same_at_every_resolution(edge_m):
    fabric = FABRICS["blender_cotton"]
    one, other = cloth_parameters(fabric, 0.01), cloth_parameters(fabric, edge_m)
    # What a square metre weighs, pulls with and feels of the air.
    assert other.mass / edge_m**2 == pytest.approx(one.mass / 0.01**2)
    assert other.tension_stiffness / edge_m == pytest.approx(one.tension_stiffness / 0.01)
    assert other.bending_stiffness * edge_m**2 == pytest.approx(one.bending_stiffness * 1e-4)
    assert other.bending_damping * edge_m**2 == pytest.approx(one.bending_damping * 1e-4)
    assert other.air_damping / other.mass == pytest.approx(one.air_damping / one.mass)


@pytest.mark.parametrize("edge_m", [0.01, 0.02])
def test_a_hanging_strip_stretches_by_the_fabrics_stiffness(run, edge_m):
    """With threads along both diagonals, cloth is 1.5 times as stiff as those along it alone."""
    limp = {"bending_warp_n_m": 1e-9, "bending_weft_n_m": 1e-9}
    fabric = replace(FABRICS["blender_silk"], drag_kg_m2_s=3, **limp)
    length_m = 0.2
    rows = 1 + round(length_m / edge_m)
    pin = np.zeros((rows, COLUMNS), dtype=np.float32)
    pin[0] = 1
    (moved,) = run(
        [sheet(1.0, rows, COLUMNS, edge_m, pin=pin.ravel(), fabric=fabric)],
        90,
        pin_weight=1.0,
        steps=20,
    )
    stretch_m = 1 - moved[-1, -COLUMNS:, 2].mean() - length_m
    # The outermost threads have diagonals on one side only.
    stiffness = (1 + 0.5 * (COLUMNS - 1) / COLUMNS) * 45
    weight = fabric.density_kg_m2 * 9.81
    assert stretch_m == pytest.approx(weight * length_m**2 / 2 / stiffness, rel=0.2)


@pytest.mark.parametrize("name", ["blender_cotton", "blender_silk"])
def test_still_air_holds_falling_cloth_back(run, name):
    fabric = FABRICS[name]
    (fall,) = run([sheet(5.0, rows=5, fabric=fabric)], 20)
    speed = -np.diff(fall[:, :, 2].mean(axis=1)) * FPS
    pull = fabric.density_kg_m2 * (9.81 - np.diff(speed) * FPS)
    drag = pull / ((speed[1:] + speed[:-1]) / 2)
    assert drag[5:] == pytest.approx(np.full(len(drag) - 5, fabric.drag_kg_m2_s), rel=0.02)


@pytest.mark.parametrize("edge_m", [0.01, 0.02])
def test_a_board_sags_by_the_fabrics_bending_stiffness(run, edge_m):
    """Small angles: each hinge turns by the moment of the rows beyond it over its stiffness."""
    ratio = edge_m / UNIT_EDGE_M
    # Light in thick air, so that it comes to rest at once; as stiff as its length asks for.
    board = replace(
        FABRICS["blender_denim"],
        density_kg_m2=0.1,
        drag_kg_m2_s=3,
        bending_warp_n_m=5e-5 * ratio**3,
        bending_weft_n_m=5e-5 * ratio**3,
    )
    beyond = 4
    pin = np.zeros((2 + beyond, COLUMNS), dtype=np.float32)
    pin[:2] = 1
    piece = sheet(1.0, 2 + beyond, COLUMNS, edge_m, pin=pin.ravel(), fabric=board)
    (moved,) = run([piece], 60, pin_weight=1.0, steps=20)
    sag = 1 - moved[-1, -COLUMNS:, 2].mean()
    # There is a hinge less across than there are vertices to hold.
    row_weight = board.density_kg_m2 * 9.81 * edge_m * COLUMNS / (COLUMNS - 1)
    moments = [row_weight * edge_m * k * (k + 1) / 2 for k in range(1, beyond + 1)]
    angles = np.array(moments) * edge_m / board.bending_warp_n_m
    assert sag == pytest.approx(edge_m * (angles * np.arange(1, beyond + 1)).sum(), rel=0.2)
