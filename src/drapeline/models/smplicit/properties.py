"""Kinds of garments that SMPLicit's gallery shows as prototypes (4.1)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.models.smplicit.variants import FIELD_MODELS
from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS


def region_of(model: str) -> str:
    """The region of the body that the garments of a model of `FIELD_MODELS` cover."""
    return GARMENT_TYPES[FIELD_MODELS[model].garments[0]].region


class Kind(NamedTuple):
    """Garments that have a prototype (4.1).

    Attributes:
        garment: their type.
        bounds: property -> lowest and highest value of those that belong to it.
    """

    garment: str
    bounds: Mapping[str, tuple[float, float]] = {}


_SHORT, _LONG = (-np.inf, 0.5), (0.65, np.inf)
_STRAPS, _SLEEVES = (-np.inf, 0.18), (0.18, np.inf)
KINDS = {
    "upper": {
        "t-shirt": Kind("Tshirt", {"sleeve": _SHORT}),
        "long-sleeved shirt": Kind("Tshirt", {"sleeve": _LONG}),
        "long shirt": Kind("Tshirt", {"hem": (1.0, np.inf)}),
        "top": Kind("Top"),
    },
    "trousers": {
        "shorts": Kind("Trousers", {"leg": _SHORT}),
        "long trousers": Kind("Trousers", {"leg": _LONG}),
    },
    "skirt": {
        "short skirt": Kind("Skirt", {"leg": _SHORT}),
        "long skirt": Kind("Skirt", {"leg": _LONG}),
    },
    "whole": {
        "dress with straps": Kind("Dress", {"sleeve": _STRAPS}),
        "dress with sleeves": Kind("Dress", {"sleeve": _SLEEVES}),
        "jumpsuit with straps": Kind("Jumpsuit", {"sleeve": _STRAPS}),
        "jumpsuit with sleeves": Kind("Jumpsuit", {"sleeve": _SLEEVES}),
    },
}


def kind_members(
    model: str, garments: np.ndarray, values: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Which garments are of each kind that a model has prototypes of.

    Args:
        model: of `FIELD_MODELS`.
        garments: (N,) types, indices into `GARMENTS`.
        values: property -> (N,), as `measure_properties` gives them.

    Returns:
        Kind -> (N,) bool.
    """
    members = {}
    for name, kind in KINDS[model].items():
        chosen = np.asarray(garments) == GARMENTS.index(kind.garment)
        for key, (low, high) in kind.bounds.items():
            chosen &= (values[key] >= low) & (values[key] <= high)
        members[name] = chosen
    return members
