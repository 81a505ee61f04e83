"""Garments of codes on their wearers: at rest, and worn in a pose, skinned or draped."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.bodies.follow import PosedBody
from drapeline.geometry.mesh import Mesh, loop_count
from drapeline.metrics.garment import piece_count
from drapeline.models.pictures.dressed import FittedGarment
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.worn import SkinningOptions, pose_in_layers


class BodyShape(NamedTuple):
    """Gender, "female" or "male", and shape (10,) of a wearer."""

    gender: str
    shape: np.ndarray


def decode_worn(
    body: PosedBody,
    wearer: BodyShape,
    codes: Mapping[str, tuple[SmplicitModel, np.ndarray]],
    skinning: SkinningOptions,
    meshing: Meshing,
) -> dict[str, FittedGarment]:
    """Sheets of codes, at rest and worn in layers.

    Args:
        body: the wearer, at rest and posed.
        wearer: gender and shape.
        codes: model and code of each garment, from the innermost to the outermost.
        skinning: how sheets follow the body.
    """
    sheets = {
        name: model.decode(z, gender=wearer.gender, shape=wearer.shape, meshing=meshing).sheet
        for name, (model, z) in codes.items()
    }
    worn = pose_in_layers(sheets, body, skinning)
    return {name: FittedGarment(z, sheets[name], worn[name]) for name, (_, z) in codes.items()}


def keep_topology(
    outfit: Mapping[str, FittedGarment], known: Mapping[str, FittedGarment]
) -> dict[str, FittedGarment]:
    """Garments, or known ones in place of those that have other pieces or openings than these."""
    return {
        name: garment if _kind(garment.sheet) == _kind(known[name].sheet) else known[name]
        for name, garment in outfit.items()
    }


def _kind(sheet: Mesh) -> tuple[int, int]:
    """Numbers of pieces and of openings."""
    return piece_count(sheet), loop_count(sheet.faces)
