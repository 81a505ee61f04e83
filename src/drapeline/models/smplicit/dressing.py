"""Garments of codes on their wearers: at rest, and worn in a pose, skinned or draped."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from drapeline.bodies.follow import PosedBody
from drapeline.bodies.model import BodyModel
from drapeline.geometry.mesh import Mesh, loop_count
from drapeline.metrics.garment import piece_count
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.worn import DrapedSheet, SkinningOptions, pose_in_layers


class FittedGarment(NamedTuple):
    """A garment that a picture or a scan shows.

    Attributes:
        z: (cut + style,) its code.
        sheet: at rest, root-relative metres, Z up; no faces if nothing is left of it.
        posed: as it is worn, in the world of the camera or of the scan.
    """

    z: np.ndarray
    sheet: Mesh
    posed: Mesh


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


class Draper(Protocol):
    """Drapes sheets on people, see `drapeline.generation.moving_sheets.SolverDraper`."""

    def __call__(
        self,
        sheets: Mapping[str, Mesh],
        body: BodyModel,
        gender: str,
        shape: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        up: np.ndarray,
    ) -> dict[str, DrapedSheet]:
        """Sheets by garment type as they hang; none if that failed."""
        ...


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


def use_draped(
    outfit: Mapping[str, FittedGarment], draped: Mapping[str, DrapedSheet]
) -> dict[str, FittedGarment]:
    """Garments as they hang; those that do not, as they are."""
    return {
        name: garment._replace(sheet=draped[name].rest, posed=draped[name].posed)
        if name in draped
        else garment
        for name, garment in outfit.items()
    }
