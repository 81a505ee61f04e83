"""Which garment types share a model, and where its fields are defined."""

from typing import NamedTuple

from drapeline.outfits.garment_types import GARMENT_TYPES

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


class FieldModel(NamedTuple):
    """A model of SMPLicit.

    Attributes:
        garments: the types that it is trained on.
        box: lowest and highest corner of the space around the body at rest, with the root joint at
            the origin, Z up, metres. It holds the garments of the largest body.
    """

    garments: tuple[str, ...]
    box: Box


_ARMS, _LEGS, _DEPTH = 0.95, 0.7, 0.6
_TOP, _WAIST, _HIP, _FLOOR = 0.85, 0.35, -0.35, -1.25


def _types(region: str, *skirts: bool) -> tuple[str, ...]:
    return tuple(
        name
        for name, garment_type in GARMENT_TYPES.items()
        if garment_type.region == region and garment_type.skirt in skirts
    )


# The paper has the first three (3.3); it leaves garments for the whole body out.
FIELD_MODELS = {
    "upper": FieldModel(_types("upper", False), ((-_ARMS, -_DEPTH, _HIP), (_ARMS, _DEPTH, _TOP))),
    "trousers": FieldModel(
        _types("lower", False), ((-_LEGS, -_DEPTH, _FLOOR), (_LEGS, _DEPTH, _WAIST))
    ),
    "skirt": FieldModel(
        _types("lower", True), ((-_LEGS, -_DEPTH, _FLOOR), (_LEGS, _DEPTH, _WAIST))
    ),
    "whole": FieldModel(
        _types("whole", False, True), ((-_ARMS, -_DEPTH, _FLOOR), (_ARMS, _DEPTH, _TOP))
    ),
}
MODEL_OF_GARMENT = {
    garment: name for name, model in FIELD_MODELS.items() for garment in model.garments
}
