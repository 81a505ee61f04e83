"""Garments that settle on the dress form, and a sheet that settles alone."""

import numpy as np
import pytest

from drapeline.geometry.mesh import edge_lengths, edges
from drapeline.outfits.settling import drape_on_form, seed_folds, settle
from drapeline.seeding import rng_for

EDGE_M = 0.025


def test_settling_keeps_off_the_form_and_holds_the_waist(garments, templates):
    form = templates.form
    for name in ("Trousers", "Tshirt", "Dress"):
        pattern = garments[name][0]
        points = drape_on_form(rng_for(1, name), form, pattern, EDGE_M, 0.01)
        high = points[:, 2] > form.landmarks["waist"]
        value = np.where(high, form.upper.value(points), form.lower.value(points))
        assert value.min() > 0.003
        assert np.linalg.norm(points - pattern.vertices, axis=1).max() < 0.06
        if name == "Trousers":
            waist = pattern.marks["waist"]
            np.testing.assert_array_equal(points[waist], pattern.vertices[waist])


@pytest.fixture(scope="module")
def sheet():
    """A square of 11 x 11 vertices, edges of 2 cm, hanging in the plane y = 0: vertices, faces."""
    z, x = np.divmod(np.arange(121.0), 11)
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.stack([corner, corner + 1, corner + 12, corner + 11], axis=1)
    return 0.02 * np.column_stack([x, 0 * x, z]), faces


def settled(sheet, **changes):
    vertices, faces = sheet
    count = len(vertices)
    options = {"fullness": np.zeros(count), "nudge": np.zeros((count, 3)), "steps": 30}
    held = vertices[:, 2] > 0.19
    return settle(vertices, faces, held, lambda p: p, **{**options, **changes}), held


def test_a_sheet_hangs_from_what_is_held_and_hardly_stretches(sheet):
    out, held = settled(sheet)
    np.testing.assert_array_equal(out[held], sheet[0][held])
    fall = (sheet[0] - out)[:, 2]
    assert 0 < fall[:11].mean() < 0.01
    pairs = edges(sheet[1])
    np.testing.assert_allclose(edge_lengths(out, pairs), 0.02, rtol=0.1)


def test_fullness_lengthens_the_weft_and_deepens_the_folds_that_are_seeded(sheet):
    nudge = seed_folds(rng_for(0, "folds"), sheet[1], 121, 0.02, 2e-4)
    fullness = np.full(121, 0.05)
    plain, held = settled(sheet, nudge=nudge)
    full, _ = settled(sheet, nudge=nudge, fullness=fullness)
    weft = np.stack([np.arange(10), np.arange(1, 11)], axis=1)
    lengths = [edge_lengths(out, weft).sum() for out in (plain, full)]
    assert 1.02 < lengths[1] / lengths[0] < 1.06
    deep, shallow = (np.abs(out[~held, 1]).mean() for out in (full, plain))
    assert deep > 1.25 * shallow
    unseeded, _ = settled(sheet, fullness=fullness)
    assert not unseeded[:, 1].any()


def test_nothing_passes_what_keeps_it_out(sheet):
    vertices, faces = sheet
    nudge = np.tile([0.0, 0.01, 0.0], (121, 1))
    none = np.zeros(121, dtype=bool)
    out = settle(
        vertices,
        faces,
        none,
        lambda p: np.maximum(p, [-1, 0.005, -1]),
        fullness=np.zeros(121),
        nudge=nudge,
        steps=5,
    )
    assert out[:, 1].min() >= 0.005


def test_seeds_of_folds_have_their_size_and_run_along_the_warp(sheet):
    noise = seed_folds(rng_for(0, "folds"), sheet[1], 121, 0.02, 0.003).reshape(11, 11, 3)
    assert np.sqrt((noise**2).mean()) == pytest.approx(0.003)
    along, around = (np.abs(np.diff(noise, axis=axis)).mean() for axis in (0, 1))
    assert along < 0.6 * around
