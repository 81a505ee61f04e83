"""Garment synthesis: templates, cuts, resizing, sewing (CLOTH3D 3.2)."""

from drapeline.outfits.outfit import (
    GARMENTS,
    KINDS,
    Garment,
    Outfit,
    load_outfit,
    outfit_plan,
    sample_outfit,
)
from drapeline.outfits.ranges import OutfitRanges
from drapeline.outfits.templates import Templates, build_templates, load_templates

__all__ = [
    "GARMENTS",
    "KINDS",
    "Garment",
    "Outfit",
    "OutfitRanges",
    "Templates",
    "build_templates",
    "load_outfit",
    "load_templates",
    "outfit_plan",
    "sample_outfit",
]
