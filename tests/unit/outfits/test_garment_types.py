"""Garment types."""

import pytest

from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from drapeline.outfits.garment_types import (
    GARMENT4D_TYPES,
    GARMENT_TYPES,
    GARMENTS,
    OUTFIT_TYPES,
    SKIRTS,
    TABLE_TYPES,
    GarmentType,
    first_of_each,
    layered,
    part_of_body,
)


def test_types_keep_their_positions_which_files_store():
    assert GARMENTS[:6] == ("Tshirt", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress")
    assert [GARMENTS.index(name) for name in SKIRTS[:2]] == [3, 5]
    assert set(GARMENT4D_TYPES) <= set(GARMENTS)


def test_tables_have_every_type_once_and_begin_with_those_that_models_are_compared_on():
    assert TABLE_TYPES[: len(GARMENT4D_TYPES)] == GARMENT4D_TYPES
    assert sorted(TABLE_TYPES) == sorted(GARMENTS)


def test_every_type_is_worn_and_every_outfit_covers_both_halves_of_the_body_once():
    outfits = [outfit_type.split("+") for outfit_type in OUTFIT_TYPES]
    assert {name for names in outfits for name in names} == set(GARMENTS)
    for names in outfits:
        worn = [GARMENT_TYPES[name] for name in names]
        regions = sorted(kind.region for kind in worn if not kind.outer)
        assert regions in (["whole"], ["lower", "upper"])


@pytest.mark.parametrize(
    ("kind", "parts"),
    [
        (GarmentType("upper", sleeve_chance=1.0), ("upper",)),
        (GarmentType("lower"), ("trousers",)),
        (GarmentType("lower", skirt=True), ("skirt",)),
        (GarmentType("whole"), ("upper", "trousers")),
        (GarmentType("whole", skirt=True), ("upper", "skirt")),
    ],
)
def test_the_parts_of_a_garment_follow_from_its_region_and_its_legs(kind, parts):
    assert kind.parts == parts


def test_parts_of_the_body_are_those_that_smplicit_has_models_of():
    assert {garment: part_of_body(garment) for garment in GARMENTS} == MODEL_OF_GARMENT


def test_the_first_of_each_type_comes_in_the_order_of_types_and_no_more_is_read():
    found = first_of_each([("Skirt", 1), ("Top", 2), ("Skirt", 3), ("Tshirt", 4)])
    assert found == [4, 2, 1]
    count = len(GARMENTS)
    endless = ((GARMENTS[k % count], k) for k in range(10**9))
    assert first_of_each(endless) == list(range(count))
    assert next(endless)[1] == count
    assert first_of_each([]) == []
    two = ((("Skirt", "Top")[k % 2], k) for k in range(10**9))
    assert first_of_each(two, ["Top", "Skirt"]) == [1, 0]
    assert next(two)[1] == 2


def test_upper_garments_are_worn_over_lower_ones():
    assert layered(["Top", "Trousers"]) == ("Trousers", "Top")
    assert layered(["Skirt", "Tshirt"]) == ("Skirt", "Tshirt")
    assert layered(["Dress"]) == ("Dress",)
    assert layered(["Jacket", "Top", "Trousers"]) == ("Trousers", "Top", "Jacket")
