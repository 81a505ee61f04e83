"""The models: garment types that share one, the box of its fields, its kinds of prototypes."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


class FieldModel(NamedTuple):
    """A model of SMPLicit.

    Attributes:
        garments: the types that it is trained on.
        box: lowest and highest corner of the space around the body at rest, with the root joint at
            the origin, Z up, metres. It holds the garments of the largest body.
        space_share: how many times as many points of the space around garments as the settings name
            a training step takes. Large boxes take more.
    """

    garments: tuple[str, ...]
    box: Box
    space_share: int = 1


def _types(region: str, *skirts: bool) -> tuple[str, ...]:
    return tuple(
        name
        for name, garment_type in GARMENT_TYPES.items()
        if garment_type.region == region and garment_type.skirt in skirts
    )


# The paper has the first three (3.3); it leaves garments for the whole body out.
FIELD_MODELS = {
    "upper": FieldModel(_types("upper", False), ((-0.85, -0.32, -0.2), (0.85, 0.3, 0.75))),
    "trousers": FieldModel(_types("lower", False), ((-0.52, -0.3, -1.12), (0.52, 0.3, 0.3))),
    "skirt": FieldModel(_types("lower", True), ((-0.65, -0.55, -0.95), (0.65, 0.55, 0.3))),
    "whole": FieldModel(_types("whole", False, True), ((-0.9, -0.52, -1.05), (0.9, 0.5, 0.8)), 2),
}
MODEL_OF_GARMENT = {
    garment: name for name, model in FIELD_MODELS.items() for garment in model.garments
}


def region_of(model: str) -> str:
    """The region of the body that the garments of a model of `FIELD_MODELS` cover."""
    return GARMENT_TYPES[FIELD_MODELS[model].garments[0]].region


class Kind(NamedTuple):
    """Garments that have a prototype (4.1)."""

    garment: str  # their type
    # Property -> lowest and highest value of those that belong to it.
    bounds: Mapping[str, tuple[float, float]] = {}


_SHORT, _LONG = (-np.inf, 0.5), (0.65, np.inf)
_STRAPS, _SLEEVES = (-np.inf, 0.18), (0.18, np.inf)
KINDS = {
    "upper": {
        "t-shirt": Kind("Tshirt", {"sleeve": _SHORT}),
        "long-sleeved shirt": Kind("Tshirt", {"sleeve": _LONG}),
        "long shirt": Kind("Tshirt", {"hem": (1.0, np.inf)}),
        "top": Kind("Top"),
        "jacket": Kind("Jacket"),
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
    """Members of each kind of garments that a model has prototypes of.

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
