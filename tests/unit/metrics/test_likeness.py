"""Measures of cloth that need no true garment, on tubes."""

import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.likeness import Variety, cloth_measures, variety
from toys.tiny_sample import tube


def cloth(around=120, rows=100, change=lambda points: 0.0):
    mesh = tube(0.15, -0.4, 0.4, around=around, rows=rows)
    points = mesh.vertices * [1, 1 / 0.6, 1]
    out = points * [1, 1, 0] / 0.15
    return Mesh(
        (points + np.asarray(change(points))[..., None] * out).astype(np.float32), mesh.triangles
    )


def ribs(wave_m, height_m):
    return lambda points: height_m * np.sin(2 * np.pi * points[:, 2] / wave_m)


def test_a_plain_tube_has_no_folds_whatever_its_mesh():
    for size in ((60, 50), (120, 100)):
        measures = cloth_measures(cloth(*size))
        assert measures["self_crossings"] == 0
        assert max(measures[f"folds_{s}cm_mm"] for s in (1, 2)) < 0.1
        assert measures["hem_mm"] < 0.1


@pytest.mark.parametrize(("wave_m", "scale"), [(0.05, 1), (0.1, 2), (0.2, 4)])
def test_folds_are_found_at_their_scale(wave_m, scale):
    measures = cloth_measures(cloth(change=ribs(wave_m, 0.004)))
    found = {s: measures[f"folds_{s}cm_mm"] for s in (1, 2, 4)}
    assert max(found, key=found.get) == scale
    coarse = cloth_measures(cloth(80, 70, change=ribs(wave_m, 0.004)))
    assert coarse[f"folds_{scale}cm_mm"] == pytest.approx(found[scale], rel=0.25)


def test_jagged_hems_and_crossed_cloth_are_found():
    plain = cloth()
    jagged = plain.vertices.copy()
    top = jagged[:, 2] > 0.399
    jagged[np.flatnonzero(top)[::2], 2] += 0.008
    assert cloth_measures(Mesh(jagged, plain.faces))["hem_mm"] > 1
    crossed = plain.vertices.copy()
    crossed[np.abs(crossed[:, 2]) < 0.05, 0] *= -1.2
    assert cloth_measures(Mesh(crossed, plain.faces))["self_crossings"] > 0
    nothing = cloth_measures(Mesh(plain.vertices[:0], plain.faces[:0]))
    assert np.isnan([*nothing.values()]).all()


def test_variety_counts_what_is_as_near_as_real_garments_are():
    def near(one, other):
        return abs(one - other)

    held_out, real = [0.0, 10.0], [1.0, 11.0]
    one = variety({"Top": [0.5]}, {"Top": held_out}, {"Top": real}, near)
    assert one == Variety(covered_share=0.5, nearest_mm=5.0, precise_mm=0.5)
    all_of_them = variety({"Top": held_out}, {"Top": held_out}, {"Top": real}, near)
    assert all_of_them == Variety(1.0, 0.0, 0.0)
    assert np.isnan(variety({"Top": [0.5]}, {"Dress": held_out}, {"Top": real}, near)).all()
