"""Patterns: what garments are made of before they are fitted to anyone."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_loops, edge_counts, edges, face_normals, triangulate
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.outfit import sample_numbers
from drapeline.outfits.patterns.cutting import (
    cut_garment,
    settled,
    skirt_cut,
    trousers_cut,
    upper_cut,
)
from drapeline.seeding import rng_for

EDGE_M = 0.025
PARTS = ("upper", "trousers", "skirt")


@pytest.fixture(scope="session")
def garments(templates, upper_numbers, trousers_numbers, skirt_numbers):
    """name -> (pattern, openings, Euler characteristic 2 - openings)."""
    top = {k: v for k, v in upper_numbers.items() if not k.startswith("sleeve")}
    top |= {"strap_m": 0.04, "scye_m": 0.015, "neck_width_m": 0.09, "drop_m": 0.01}
    sheets = {
        "Tshirt": (dict(upper=upper_numbers), 4),
        "polo": (dict(upper=upper_numbers | {"front": "polo", "placket_m": 0.12}), 4),
        "open": (dict(upper=upper_numbers | {"front": "open"}), 3),
        "Top": (dict(upper=top), 4),
        "Trousers": (dict(trousers=trousers_numbers), 3),
        "Skirt": (dict(skirt=skirt_numbers), 2),
        "Jumpsuit": (dict(upper=upper_numbers, trousers=trousers_numbers), 5),
        "Dress": (dict(upper=top, skirt=skirt_numbers), 4),
    }
    return {
        name: (cut_garment(templates.form, EDGE_M, **parts), openings)
        for name, (parts, openings) in sheets.items()
    }


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
def test_texture_panels_lie_flat_without_overlaps(garments, name):
    uv, uv_faces = garments[name][0].texture()
    assert uv.min() >= 0
    assert uv.max() <= 1
    corners = uv[triangulate(uv_faces)].astype(np.float64)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    assert area.min() > 0
    # Rasterised: no sample of the square lies in two triangles.
    size = 300
    covered = np.zeros((size, size), dtype=int)
    for triangle, twice in zip(corners, area, strict=True):
        low = np.floor(triangle.min(axis=0) * size - 0.5).astype(int) + 1
        high = np.floor(triangle.max(axis=0) * size - 0.5).astype(int) + 1
        x, y = (np.arange(low[k], high[k]) for k in (0, 1))
        p = (np.stack(np.meshgrid(x, y, indexing="ij"), -1) + 0.5) / size
        sides = [np.cross(triangle[k - 2] - triangle[k], p - triangle[k]) / twice for k in range(3)]
        covered[np.ix_(x, y)] += (np.array(sides) > 1e-9).all(axis=0)
    assert covered.max() == 1
    assert covered.mean() > 0.25


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


def test_settling_keeps_off_the_form_and_holds_the_waist(garments, templates):
    form = templates.form
    for name in ("Trousers", "Tshirt", "Dress"):
        pattern = garments[name][0]
        points = settled(rng_for(1, name), form, pattern, EDGE_M, 0.01)
        high = points[:, 2] > form.landmarks["waist"]
        value = np.where(high, form.upper.value(points), form.lower.value(points))
        assert value.min() > 0.003
        assert np.linalg.norm(points - pattern.vertices, axis=1).max() < 0.06
        if name == "Trousers":
            waist = pattern.marks["waist"]
            np.testing.assert_array_equal(points[waist], pattern.vertices[waist])


def test_the_two_legs_of_trousers_stay_apart(garments):
    pattern = garments["Trousers"][0]
    points = pattern.vertices
    assert points[pattern.marks["left_leg"], 0].min() > 0.003
    assert points[pattern.marks["right_leg"], 0].max() < -0.003


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
