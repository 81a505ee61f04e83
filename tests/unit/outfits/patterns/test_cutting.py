"""Patterns: what garments are made of before they are fitted to anyone."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_loops, edge_counts, edges, face_normals, triangulate
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_numbers
from drapeline.outfits.patterns.cutting import cut_garment, skirt_cut, trousers_cut, upper_cut
from drapeline.seeding import rng_for

EDGE_M = 0.025
PARTS = ("upper", "trousers", "skirt")


NAMES = ("Tshirt", "polo", "open", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress")


@pytest.mark.parametrize("name", NAMES)
def test_garments_are_manifold_quads_with_the_right_openings(garments, name):
    pattern, openings = garments[name]
    faces, points = pattern.faces(), pattern.vertices
    pairs, counts = edge_counts(faces)
    assert faces.shape[1] == 4
    assert counts.max() == 2
    assert np.unique(faces).tolist() == list(range(len(points)))
    assert len(boundary_loops(faces)) == openings
    # A sphere with that many holes: no handles, all in one piece.
    assert len(points) - len(pairs) + len(faces) == 2 - openings


@pytest.mark.parametrize("name", NAMES)
def test_neighbouring_faces_turn_the_same_way_and_outwards(garments, templates, name):
    pattern, _ = garments[name]
    faces, points = pattern.faces(), pattern.vertices
    half = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert len(np.unique(half, axis=0)) == len(half)
    triangles = triangulate(faces)
    normals = face_normals(points, triangles)
    middle = points[triangles].mean(axis=1)
    high = middle[:, 2] > templates.form.landmarks["waist"]
    out = np.where(
        high[:, None],
        templates.form.upper.direction(middle),
        templates.form.lower.direction(middle),
    )
    assert (np.einsum("fi,fi->f", normals, out) > 0).mean() > 0.97


@pytest.mark.parametrize("name", NAMES)
def test_mean_edge_is_near_the_wanted_length(garments, name):
    pattern, _ = garments[name]
    pairs = edges(pattern.faces())
    length = np.linalg.norm(pattern.vertices[pairs[:, 0]] - pattern.vertices[pairs[:, 1]], axis=1)
    assert 0.75 * EDGE_M < length.mean() < 1.3 * EDGE_M
    assert np.percentile(length, 99) < 3 * EDGE_M
    assert np.percentile(length, 1) > 0.3 * EDGE_M


def test_edge_length_sets_the_number_of_vertices(templates, trousers_numbers):
    coarse, fine = (
        cut_garment(templates.form, e, trousers=trousers_numbers).count for e in (0.03, 0.015)
    )
    assert 3.4 < fine / coarse < 4.6


def test_cuts_are_exact_planes(garments, templates, upper_numbers, trousers_numbers, skirt_numbers):
    form = templates.form
    shirt = garments["Tshirt"][0]
    cut = upper_cut(form, upper_numbers)
    left, right = (shirt.vertices[shirt.marks[f"{side}_cuff"]] for side in ("left", "right"))
    np.testing.assert_allclose(left[:, 0], cut.sleeve_x, atol=1e-9)
    np.testing.assert_allclose(right[:, 0], -cut.sleeve_x, atol=1e-9)
    np.testing.assert_allclose(shirt.vertices[shirt.marks["hem"], 2], cut.hem, atol=1e-9)
    skirt = garments["Skirt"][0]
    hem = skirt.vertices[skirt.marks["skirt_hem"], 2]
    np.testing.assert_allclose(hem, skirt_cut(form, skirt_numbers).hem, atol=1e-9)
    trousers = garments["Trousers"][0]
    waist = trousers.vertices[trousers.marks["waist"], 2]
    np.testing.assert_allclose(waist, trousers_cut(form, trousers_numbers).waist, atol=1e-9)
    # Legs are cut square to their axis, which is opened by 0.15 rad.
    cuff = trousers.vertices[trousers.marks["left_leg_cuff"]]
    along = cuff @ [np.sin(0.15), 0, -np.cos(0.15)]
    assert np.ptp(along) < 1e-3


def test_longer_cuts_make_longer_garments(templates, upper_numbers):
    reach = [
        cut_garment(templates.form, EDGE_M, upper=upper_numbers | {"sleeve_length": share})
        .vertices[:, 0]
        .max()
        for share in (0.2, 0.6, 1.0)
    ]
    assert np.all(np.diff(reach) > 0.1)


def test_symmetric_numbers_make_symmetric_garments(garments):
    for name in ("Tshirt", "Top", "Trousers", "Jumpsuit"):
        points = garments[name][0].vertices
        mirrored = points * [-1, 1, 1]
        nearest = np.linalg.norm(points[:, None] - mirrored[None], axis=2).min(axis=1)
        assert nearest.max() < 1e-4


@pytest.mark.parametrize("edge_m", [0.012, 0.03, 0.05])
def test_random_garments_are_sound_at_every_resolution(templates, edge_m):
    ranges = OutfitRanges()
    for draw in range(4):
        rng = rng_for(2, draw, str(edge_m))
        for name, openings in (("Tshirt", 4), ("Top", 4), ("Dress", 4), ("Jumpsuit", 5)):
            ((_, about),) = sample_numbers(rng, name, ranges)
            parts = {k: v for k, v in about["parameters"].items() if k in PARTS}
            pattern = cut_garment(templates.form, edge_m, **parts)
            faces = pattern.faces()
            assert np.isfinite(pattern.vertices).all()
            assert edge_counts(faces)[1].max() == 2
            is_open = parts["upper"]["front"] == "open"
            assert len(boundary_loops(faces)) == openings - is_open
