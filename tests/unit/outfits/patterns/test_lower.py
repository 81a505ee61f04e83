"""Trousers and skirts."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_loops
from drapeline.outfits.patterns.curves import curve_length
from drapeline.outfits.patterns.cutting import cut_garment, skirt_cut, trousers_cut
from drapeline.outfits.patterns.lower import skirt_half_ring, trousers_half_ring

EDGE_M = 0.025


def test_sewing_merges_the_waist_one_to_one(garments, templates, upper_numbers, trousers_numbers):
    sewn = garments["Jumpsuit"][0]
    ring = sewn.marks["waist"]
    faces = sewn.faces()
    # Every vertex of the seam is inside the cloth: four faces around it, no opening through it.
    open_ids = np.concatenate(boundary_loops(faces))
    assert not np.isin(ring, open_ids).any()
    assert (np.bincount(faces.ravel())[ring] == 4).all()
    height = sewn.vertices[ring, 2]
    waist = trousers_cut(templates.form, trousers_numbers).waist
    np.testing.assert_allclose(height, waist, atol=1e-3)
    alone = cut_garment(templates.form, EDGE_M, trousers=trousers_numbers)
    assert len(alone.marks["waist"]) == len(ring)


def test_half_rings_are_even_and_follow_the_edge_length(templates, trousers_numbers, skirt_numbers):
    form = templates.form
    for count, cut in (
        (trousers_half_ring, trousers_cut(form, trousers_numbers)),
        (skirt_half_ring, skirt_cut(form, skirt_numbers)),
    ):
        coarse, fine = (count(form, cut, e) for e in (0.03, 0.01))
        assert coarse % 2 == fine % 2 == 0
        assert 2.6 < fine / coarse < 3.4
        assert count(form, cut, 1.0) == 12


def test_folds_of_a_skirt_are_as_many_as_it_has_flutes_and_deepest_at_the_hem(
    templates, skirt_numbers
):
    numbers = {k: 0.0 for k in skirt_numbers if "wander" in k}
    numbers = skirt_numbers | numbers | {"skirt_fullness": 0.1, "skirt_alpha1": 0.3}
    pattern = cut_garment(templates.form, 0.01, skirt=numbers)
    plain = cut_garment(templates.form, 0.01, skirt=numbers | {"skirt_fullness": 0.0})
    axis = [0, templates.form.skirt.centre[0, 1]]

    def radius(made, mark):
        return np.linalg.norm(made.vertices[made.marks[mark], :2] - axis, axis=1)

    np.testing.assert_allclose(radius(pattern, "waist"), radius(plain, "waist"), atol=1e-9)
    share = radius(pattern, "skirt_hem") / radius(plain, "skirt_hem") - 1
    flutes = skirt_cut(templates.form, numbers).flutes
    higher = (share > np.roll(share, 1)) & (share >= np.roll(share, -1))
    assert higher.sum() == pytest.approx(flutes, abs=2)
    assert np.ptp(share) > 0.1


def test_wider_legs_have_longer_cuffs(templates, trousers_numbers):
    lengths = []
    for width in (1.1, 1.6):
        made = cut_garment(templates.form, EDGE_M, trousers=trousers_numbers | {"leg_w0": width})
        cuff = made.vertices[made.marks["left_leg_cuff"]]
        lengths.append(curve_length(np.concatenate([cuff, cuff[:1]])))
    assert lengths[1] > lengths[0] + 0.02
