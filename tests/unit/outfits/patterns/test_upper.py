"""Upper-body garments: necklines, fronts, sleeves, armholes."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_loops
from drapeline.outfits.patterns.curves import curve_length
from drapeline.outfits.patterns.cutting import cut_garment, upper_cut
from drapeline.outfits.patterns.upper import GAP_M, chest_half_ring

EDGE_M = 0.025


def cut(templates, numbers, **changes):
    return cut_garment(templates.form, EDGE_M, upper=numbers | changes)


def test_the_half_ring_is_even_and_follows_the_edge_length(templates, upper_numbers):
    measures = upper_cut(templates.form, upper_numbers)
    coarse, fine = (chest_half_ring(templates.form, measures, e) for e in (0.03, 0.01))
    assert coarse % 2 == fine % 2 == 0
    assert 2.6 < fine / coarse < 3.4
    assert chest_half_ring(templates.form, measures, 1.0) == 16


def test_cloth_keeps_its_gap_from_the_form(templates, upper_numbers):
    points = cut(templates, upper_numbers).vertices
    assert templates.form.upper.value(points).min() > GAP_M - 0.004


def lowest_of_the_neck(pattern, templates):
    loops = boundary_loops(pattern.faces())
    top = max(loops, key=lambda loop: pattern.vertices[loop, 2].mean())
    points = pattern.vertices[top]
    return points[points[:, 1] < points[:, 1].mean(), 2].min()


@pytest.mark.parametrize("neckline", ["crew", "v", "scoop"])
def test_necklines_come_down_in_front_as_far_as_asked(templates, upper_numbers, neckline):
    high, low = (
        lowest_of_the_neck(
            cut(templates, upper_numbers, neckline=neckline, neck_depth_m=depth), templates
        )
        for depth in (0.07, 0.14)
    )
    assert 0.04 < high - low < 0.1


def test_a_v_is_pointed_and_a_scoop_is_round(templates, upper_numbers):
    """Half-way down, a scoop is wider than a v."""
    widths = {}
    for neckline in ("v", "scoop"):
        pattern = cut(templates, upper_numbers, neckline=neckline, neck_depth_m=0.15)
        loops = boundary_loops(pattern.faces())
        top = max(loops, key=lambda loop: pattern.vertices[loop, 2].mean())
        points = pattern.vertices[top]
        front = points[points[:, 1] < points[:, 1].mean()]
        middle = (front[:, 2].min() + front[:, 2].max()) / 2
        near = np.abs(front[:, 2] - middle).argsort()[:4]
        widths[neckline] = np.abs(front[near, 0]).mean()
    assert widths["scoop"] > widths["v"]


def test_an_open_front_parts_from_hem_to_neck_and_a_polo_above_alone(templates, upper_numbers):
    wide = {"placket_m": 0.1}
    opened = cut(templates, upper_numbers, front="open")
    polo = cut(templates, upper_numbers, front="polo", **wide)
    for pattern, gap in ((opened, 0.008), (polo, 0.008)):
        right, left = np.split(pattern.vertices[pattern.marks["placket"]], 2)
        np.testing.assert_allclose(left[:, 1:], right[:, 1:], atol=1e-9)
        assert (left[:, 0] - right[:, 0]).max() == pytest.approx(gap, abs=1e-6)
    right, _ = np.split(polo.vertices[polo.marks["placket"]], 2)
    assert np.ptp(right[:, 2]) == pytest.approx(0.1, abs=2 * EDGE_M)
    whole, _ = np.split(opened.vertices[opened.marks["placket"]], 2)
    assert np.ptp(whole[:, 2]) > 0.3


def test_armholes_of_both_sides_are_mirror_images(templates, upper_numbers):
    pattern = cut(templates, upper_numbers)
    left, right = (pattern.vertices[pattern.marks[f"{s}_armhole"]] for s in ("left", "right"))
    lengths = [curve_length(np.concatenate([ring, ring[:1]])) for ring in (left, right)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-3)
    assert left[:, 0].min() > 0 > right[:, 0].max()


def test_wider_sleeves_have_longer_cuffs(templates, upper_numbers):
    lengths = []
    for width in (1.4, 2.0):
        pattern = cut(templates, upper_numbers, sleeve_w0=width)
        cuff = pattern.vertices[pattern.marks["left_cuff"]]
        lengths.append(curve_length(np.concatenate([cuff, cuff[:1]])))
    assert lengths[1] > lengths[0] + 0.02


@pytest.mark.parametrize("edge_m", [0.045, 0.035, 0.02])
@pytest.mark.parametrize("hem", [0.1, 1.0])
@pytest.mark.parametrize("open_below", [-0.6, 0.6])
@pytest.mark.parametrize("unbuttoned_m", [0.03, 0.14])
def test_shirts_stay_closed_somewhere(
    templates, upper_numbers, edge_m, hem, open_below, unbuttoned_m
):
    """However short a shirt is, and however far it is open from both ends."""
    shirt = {"front": "buttoned", "placket_m": unbuttoned_m, "open_below": open_below, "hem": hem}
    pattern = cut_garment(templates.form, edge_m, upper=upper_numbers | shirt)
    assert len(boundary_loops(pattern.faces())) == 4
    right, left = np.split(pattern.marks["placket"], 2)
    closed = np.setdiff1d(np.flatnonzero(np.abs(pattern.vertices[:, 0]) < 1e-6), [*right, *left])
    front = closed[pattern.vertices[closed, 1] < pattern.vertices[:, 1].mean()]
    assert len(front) >= 3
