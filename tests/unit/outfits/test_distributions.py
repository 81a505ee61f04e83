"""What outfits are drawn from."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.fabrics import MEASURED_FABRICS
from drapeline.outfits.garment_types import FITS, GARMENTS, OUTFIT_TYPES
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


def test_another_fabric_leaves_the_cut_and_changes_the_print():
    """Even where it is for other garments: a shirt of denim is asked for by name."""
    worn = {
        fabric: sample_numbers(rng_for(3, 1), "Tshirt+Trousers", OutfitRanges(), (fabric,))
        for fabric in ("denim", "silk")
    }
    for (_, denim), (_, silk) in zip(*worn.values(), strict=True):
        assert (denim["fabric"], silk["fabric"]) == ("denim", "silk")
        assert denim["parameters"] == silk["parameters"]
        assert denim["texture"]["print"]["kind"] == "twill" != silk["texture"]["print"]["kind"]


@pytest.mark.parametrize("chance", [0.0, 0.5, 1.0])
def test_elastics_have_the_chance_they_are_given(chance):
    ranges = replace(OutfitRanges(), elastic_chance=chance).of_fit("regular")
    drawn = [
        on
        for k in range(400)
        for _, about in numbers_of(k, "Jumpsuit", ranges)
        for on in about["elastic"].values()
    ]
    assert abs(np.mean(drawn) - chance) < 0.06


def test_legs_of_fitted_garments_have_elastics_where_the_fabric_stretches():
    ranges = replace(OutfitRanges(), elastic_chance=1.0).of_fit("fitted")
    for fabric in ("jersey", "denim"):
        drawn = sample_numbers(rng_for(3, fabric), "Jumpsuit", ranges, (fabric,))
        elastic = drawn[0][1]["elastic"]
        assert elastic["legs"] == (fabric == "jersey")
        assert elastic["waist"]


def test_fits_share_ease_and_tightness_out_among_them():
    whole = OutfitRanges()
    parts = [whole.of_fit(fit) for fit in FITS]
    for name in ("ease_m", "sleeve_w0", "leg_w0", "hip_ease_m", "skirt_alpha1"):
        spans = [getattr(part, name) for part in parts]
        assert spans[0][0] == getattr(whole, name)[0]
        assert spans[-1][1] == pytest.approx(getattr(whole, name)[1])
        assert [low for low, _ in spans[1:]] == pytest.approx([high for _, high in spans[:-1]])
    assert [part.tightness for part in parts] == [
        pytest.approx(span) for span in ((-1 / 6, 0.5), (-5 / 6, -1 / 6), (-1.5, -5 / 6))
    ]
    assert parts[0].neck_width_m == whole.neck_width_m


def test_jackets_are_open_and_roomier_than_any_shirt():
    for k in range(40):
        worn = dict(numbers_of(k, "Tshirt+Trousers+Jacket"))
        shirt, jacket = (worn[name]["parameters"]["upper"] for name in ("Tshirt", "Jacket"))
        assert jacket["front"] == "open"
        assert jacket["sleeve_w0"] > shirt["sleeve_w0"]
        assert jacket["drop_m"] > shirt["drop_m"] - 0.002
        assert "collar_stand_m" not in shirt  # the jacket's lies there


def test_numbers_stay_in_their_ranges():
    ranges = OutfitRanges()
    for k in range(200):
        for name, about in numbers_of(k, OUTFIT_TYPES[k % len(OUTFIT_TYPES)]):
            parts = about["parameters"]
            if "trousers" in parts:
                for key, value in parts["trousers"].items():
                    low, high = getattr(ranges, key)
                    assert low <= value <= high
                assert parts["trousers"]["leg_alpha1"] < 0 <= parts["trousers"]["leg_alpha2"]
            if "skirt" in parts:
                assert parts["skirt"]["skirt_alpha1"] > 0
            assert 0 <= min(about["texture"]["data"]) <= max(about["texture"]["data"]) <= 1
            assert name in GARMENTS
