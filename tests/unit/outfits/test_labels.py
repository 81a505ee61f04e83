"""Codes that point clouds on disk and trained networks hold."""

from drapeline.outfits.garment_types import LABELS


def test_codes_are_those_of_existing_files():
    assert LABELS == ("Body", "Tshirt", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress", "Jacket")
