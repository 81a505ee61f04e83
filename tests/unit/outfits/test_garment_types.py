"""Garment types."""

from drapeline.outfits.garment_types import GARMENTS, first_of_each


def test_the_first_of_each_type_comes_in_the_order_of_types_and_no_more_is_read():
    found = first_of_each([("Skirt", 1), ("Top", 2), ("Skirt", 3), ("Tshirt", 4)])
    assert found == [4, 2, 1]
    endless = ((GARMENTS[k % 6], k) for k in range(10**9))
    assert first_of_each(endless) == [0, 1, 2, 3, 4, 5]
    assert next(endless)[1] == 6
    assert first_of_each([]) == []
