"""Dress forms and outfits on the toy body."""

import numpy as np
import pytest

from drapeline.outfits.garment_types import OUTFIT_TYPES
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.patterns.cutting import cut_garment
from drapeline.outfits.templates import build_templates
from drapeline.seeding import rng_for

EDGE_M = 0.025
SHIRT = {
    "front": "buttoned",
    "placket_m": 0.08,
    "open_below": 0.3,
    "collar_stand_m": 0.028,
    "collar_fall_m": 0.045,
    "collar_point_m": 0.015,
}


@pytest.fixture(scope="session")
def templates(toy_body):
    return build_templates(toy_body)


@pytest.fixture(scope="session")
def outfits(toy_body, templates):
    """One outfit of every type."""
    shapes = rng_for(5, "shape").uniform(-1, 1, (len(OUTFIT_TYPES), 10))
    return {
        outfit_type: sample_outfit(
            rng_for(5, outfit_type),
            templates,
            toy_body,
            gender="female",
            shape=shape,
            outfit_type=outfit_type,
            edge_length_m=EDGE_M,
        )
        for outfit_type, shape in zip(OUTFIT_TYPES, shapes, strict=True)
    }


@pytest.fixture(scope="session")
def upper_numbers():
    """A symmetric long-sleeved t-shirt, all numbers in the middle of their ranges."""
    return {
        "hem": 0.6,
        "ease_m": 0.01,
        "flare": 0.03,
        "shaping": 0.1,
        "neckline": "crew",
        "neck_depth_m": 0.07,
        "neck_depth_back_m": 0.02,
        "neck_width_m": 0.085,
        "drop_m": 0.03,
        "sleeve_length": 0.6,
        "sleeve_alpha1": -0.1,
        "sleeve_alpha2": 0.2,
        "sleeve_offset": 0.5,
        "sleeve_w0": 1.5,
        "front": "closed",
    }


@pytest.fixture(scope="session")
def trousers_numbers():
    return {
        "waist": 0.9,
        "leg_length": 0.7,
        "leg_alpha1": -0.1,
        "leg_alpha2": 0.2,
        "leg_offset": 0.6,
        "leg_w0": 1.2,
        "rise_m": 0.03,
        "hip_ease_m": 0.01,
    }


@pytest.fixture(scope="session")
def skirt_numbers():
    return {
        "waist": 0.9,
        "skirt_length": 0.6,
        "skirt_alpha1": 0.5,
        "skirt_flutes": 6.0,
        "skirt_fullness": 0.03,
        "skirt_phase": 0.4,
        **{f"skirt_wander{k}": float(w) for k, w in enumerate(np.linspace(0.1, 0.9, 4))},
    }


@pytest.fixture(scope="session")
def garments(templates, upper_numbers, trousers_numbers, skirt_numbers):
    """name -> (pattern, openings, Euler characteristic 2 - openings)."""
    top = {k: v for k, v in upper_numbers.items() if not k.startswith("sleeve")}
    top |= {"strap_m": 0.04, "scye_m": 0.015, "neck_width_m": 0.09, "drop_m": 0.01}
    sheets = {
        "Tshirt": (dict(upper=upper_numbers), 4),
        "polo": (dict(upper=upper_numbers | {"front": "polo", "placket_m": 0.12}), 4),
        "open": (dict(upper=upper_numbers | {"front": "open"}), 3),
        "shirt": (dict(upper=upper_numbers | SHIRT), 4),
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
