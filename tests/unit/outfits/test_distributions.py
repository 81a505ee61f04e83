"""What outfits are drawn from."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.fabrics import MEASURED_FABRICS
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers
from drapeline.seeding import rng_for


def numbers_of(index, outfit_type, ranges=None):
    return sample_numbers(rng_for(3, index), outfit_type, ranges or OutfitRanges())


def test_garments_are_of_the_given_fabrics_that_they_are_made_of():
    given = ("blender_cotton", "blender_silk", "blender_denim", "blender_leather")
    upper, other = set(), set()
    for k in range(300):
        outfit_type = OUTFIT_TYPES[k % len(OUTFIT_TYPES)]
        for name, about in sample_numbers(rng_for(3, k), outfit_type, OutfitRanges(), given):
            (upper if name in ("Tshirt", "Top") else other).add(about["fabric"])
    assert upper == {"blender_cotton", "blender_silk"}
    assert other == set(given)


def test_if_none_are_given_every_measured_fabric_is_drawn():
    drawn = {about["fabric"] for k in range(200) for _, about in numbers_of(k, "Tshirt+Trousers")}
    assert drawn == set(MEASURED_FABRICS)


@pytest.mark.parametrize("chance", [0.0, 0.5, 1.0])
def test_elastics_have_the_chance_they_are_given(chance):
    ranges = replace(OutfitRanges(), elastic_chance=chance)
    drawn = [
        on
        for k in range(400)
        for _, about in numbers_of(k, "Jumpsuit", ranges)
        for on in about["elastic"].values()
    ]
    assert abs(np.mean(drawn) - chance) < 0.06


def test_numbers_stay_in_their_ranges():
    ranges = OutfitRanges()
    for k in range(200):
        for name, about in numbers_of(k, OUTFIT_TYPES[k % len(OUTFIT_TYPES)]):
            parts = about["parameters"]
            if "trousers" in parts:
                for key, value in parts["trousers"].items():
                    low, high = getattr(ranges, key)
                    assert low <= value <= high
                assert parts["trousers"]["leg_alpha1"] < 0 < parts["trousers"]["leg_alpha2"]
            if "skirt" in parts:
                assert parts["skirt"]["skirt_alpha1"] > 0
            assert 0 <= min(about["texture"]["data"]) <= max(about["texture"]["data"]) <= 1
            assert name in GARMENTS
