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
