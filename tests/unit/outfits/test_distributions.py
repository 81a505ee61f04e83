"""What outfits are drawn from."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers
from drapeline.seeding import rng_for


def numbers_of(index, outfit_type, ranges=None):
    return sample_numbers(rng_for(3, index), outfit_type, ranges or OutfitRanges())


def test_upper_garments_are_cotton_or_silk_and_the_others_anything():
    upper, other = set(), set()
    for k in range(300):
        for name, about in numbers_of(k, OUTFIT_TYPES[k % len(OUTFIT_TYPES)]):
            (upper if name in ("Tshirt", "Top") else other).add(about["fabric"])
    assert upper == {"cotton", "silk"}
    assert other == {"cotton", "silk", "denim", "leather"}


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
