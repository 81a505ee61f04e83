"""Whole outfits on a body: fit, layers, files, what is drawn."""

import json
from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, tightness_shape
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import boundary_edges, edges, face_normals, triangulate
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.garment_types import OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers, sample_outfit
from drapeline.seeding import rng_for

ARRAYS = ("vertices", "faces", "uv", "uv_faces", "pin", "elastic", "band")


@pytest.mark.parametrize("outfit_type", OUTFIT_TYPES)
def test_no_garment_starts_inside_the_body(outfits, toy_body, outfit_type):
    outfit = outfits[outfit_type]
    body = rest_body(toy_body, tightness_shape(outfit.shape, outfit.tightness, outfit.gender))
    for garment in outfit.garments:
        distance, _ = SignedDistance(body, toy_body.faces).query(garment.vertices)
        assert distance.min() > 0.0039


@pytest.mark.parametrize("outfit_type", [name for name in OUTFIT_TYPES if "+" in name])
def test_the_upper_garment_lies_over_the_lower_one(outfits, outfit_type):
    inner, outer = outfits[outfit_type].garments[:2]
    assert inner.name in ("Trousers", "Skirt")
    assert outer.name in ("Tshirt", "Top")
    distance, _ = SignedDistance(inner.vertices, triangulate(inner.faces)).query(outer.vertices)
    overlap = outer.vertices[:, 2] < inner.vertices[:, 2].max() - 0.01
    assert (distance[overlap] > 0.002).all()


@pytest.mark.parametrize("outfit_type", [name for name in OUTFIT_TYPES if "Jacket" in name])
def test_a_jacket_lies_over_what_is_worn_beneath(outfits, outfit_type):
    *worn, jacket = outfits[outfit_type].garments
    assert jacket.name == "Jacket"
    count = 0
    for inner in worn:
        faces = triangulate(inner.faces)
        place, face = closest_points(jacket.vertices, inner.vertices, faces)
        away = jacket.vertices - place
        over = np.einsum("vi,vi->v", away, face_normals(inner.vertices, faces[face]))
        rim = np.isin(faces, boundary_edges(inner.faces)).any(axis=1)
        near = (np.linalg.norm(away, axis=1) < 0.03) & ~rim[face]
        assert (over[near] > 0.002).sum() >= 0.995 * near.sum()
        count += near.sum()
    assert count > 100


def test_same_seed_same_outfit(outfits, toy_body, templates):
    first = outfits["Tshirt+Trousers"]
    again = sample_outfit(
        rng_for(5, "Tshirt+Trousers"),
        templates,
        toy_body,
        gender="female",
        shape=first.shape,
        outfit_type="Tshirt+Trousers",
        edge_length_m=0.025,
    )
    for a, b in zip(first.garments, again.garments, strict=True):
        assert a.attributes == b.attributes
        for key in ARRAYS:
            np.testing.assert_array_equal(getattr(a, key), getattr(b, key))


def test_waistbands_and_shoulders_are_held_and_only_they(outfits):
    for outfit in outfits.values():
        for garment in outfit.garments:
            held = garment.vertices[garment.pin > 0]
            assert len(held) > 5
            if garment.name in ("Trousers", "Skirt"):
                assert held[:, 2].min() > garment.vertices[:, 2].max() - 0.06
            else:
                assert abs(held[:, 0].min() + held[:, 0].max()) < 0.02
                assert held[:, 2].min() > np.quantile(garment.vertices[:, 2], 0.8)


def test_elastic_marks_are_on_the_ends_that_have_it(outfits):
    seen = set()
    for outfit in outfits.values():
        for garment in outfit.garments:
            ends = garment.attributes["elastic"]
            assert bool(garment.elastic.any()) == any(ends.values())
            seen |= {end for end, on in ends.items() if on}
            if ends == {"sleeves": True}:
                gathered = np.abs(garment.vertices[garment.elastic > 0, 0])
                assert gathered.min() > np.abs(garment.vertices[:, 0]).max() - 0.08
    assert seen


def numbers_of(index, outfit_type, ranges=None):
    return sample_numbers(rng_for(3, index), outfit_type, ranges or OutfitRanges())


def test_two_thousand_outfits_are_all_different():
    seen = {json.dumps(numbers_of(k, OUTFIT_TYPES[k % len(OUTFIT_TYPES)])) for k in range(2000)}
    assert len(seen) == 2000


def test_small_garments_get_shorter_edges_where_a_vertex_count_is_asked_for(toy_body, templates):
    counts = {}
    for least in (0, 900):
        outfit = sample_outfit(
            rng_for(2, "least"),
            templates,
            toy_body,
            gender="female",
            shape=np.zeros(10),
            outfit_type="Top+Skirt",
            edge_length_m=0.04,
            vertices_min=least,
        )
        counts[least] = [len(garment.vertices) for garment in outfit.garments]
    assert min(counts[0]) < 900
    assert 900 <= min(counts[900]) < 1200


def test_positive_tightness_makes_smaller_garments(toy_body, templates):
    size = {}
    for gamma in (-1.5, 0.5):
        ranges = replace(OutfitRanges(), tightness=(gamma, gamma))
        outfit = sample_outfit(
            rng_for(1, "t"),
            templates,
            toy_body,
            gender="female",
            shape=np.zeros(10),
            outfit_type="Tshirt+Trousers",
            edge_length_m=0.03,
            ranges=ranges,
        )
        garment = outfit.garments[1]
        pairs = edges(garment.faces)
        size[gamma] = np.linalg.norm(
            garment.vertices[pairs[:, 0]] - garment.vertices[pairs[:, 1]], axis=1
        ).sum()
    assert size[0.5] < size[-1.5]
