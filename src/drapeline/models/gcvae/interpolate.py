"""Straight lines through codes and conditions, decoded step by step (CLOTH3D figure 9)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import Codes
from drapeline.models.gcvae.sampling.draw import decode_by_type
from drapeline.models.gcvae.sampling.types import GarmentTypes
from drapeline.models.gcvae.truth import StaticGarments
from drapeline.outfits.garment_types import GARMENTS

_SHAPE_SPAN, _TIGHT, _LOOSE = 2.5, 0.5, -1.5


class Step(NamedTuple):
    """A garment on the way.

    Attributes:
        garment: as decoded, in rest pose.
        cvar: (13,) conditions that it was decoded with.
        garment_index: its likeliest type, an index into `GARMENTS`.
    """

    garment: Mesh
    cvar: np.ndarray
    garment_index: int


def interpolate(
    model: GarmentCodec,
    types: GarmentTypes,
    start: tuple[np.ndarray, np.ndarray],
    end: tuple[np.ndarray, np.ndarray],
    steps: int,
) -> list[Step]:
    """Decode evenly spaced points between two pairs of code (Z,) and conditions (13,).

    Each is decoded on the topology of its likeliest type.
    """
    share = np.linspace(0, 1, steps)[:, None]
    z, cvar = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    out = []
    template = model.body_template
    decoded = decode_by_type(model, types, z, cvar, [None] * steps)
    for (garment_index, offsets, mask), condition in zip(decoded, cvar, strict=True):
        vertices = template.rest_body(condition) + offsets
        mesh = garment_mesh(vertices, template.faces_of(garment_index), mask)
        out.append(Step(mesh, condition, garment_index))
    return out


def interpolate_as_figure_9(
    model: GarmentCodec,
    types: GarmentTypes,
    garments: StaticGarments,
    rows: np.ndarray,
    codes: Codes,
    steps: int,
) -> dict[str, list[Step]]:
    """The rows of figure 9: shape, tightness, cloth, cloth across topologies, and all at once.

    Args:
        rows: (n,) garments; the first of each type is where a row starts or ends. A row that needs
            a type not among them is left out.
        codes: (n, Z) of these garments.
        steps: garments per row.

    Returns:
        What changes -> steps.
    """
    garment_indices = np.asarray(garments.garment)[rows]
    cvar = garments.cvar(rows)
    first: Mapping[str, int] = {
        name: int(np.flatnonzero(garment_indices == index)[0])
        for index, name in enumerate(GARMENTS)
        if (garment_indices == index).any()
    }

    def at(name: str, **changed: object) -> tuple[np.ndarray, np.ndarray]:
        """A garment's code and conditions, with another shape or tightness."""
        condition = cvar[first[name]].copy()
        for part, value in changed.items():
            condition[_CVAR_PARTS[part]] = value
        return codes.mean[first[name]], condition

    def tightness(name: str, value: float) -> list[float]:
        female = cvar[first[name]][10] == 0
        return [-value if female else value, value]

    average = np.zeros(10)
    small, large = np.zeros((2, 10))
    small[:2], large[:2] = -_SHAPE_SPAN, _SHAPE_SPAN
    needed_types: dict[str, tuple[str, ...]] = {
        "shape": ("Dress",),
        "tightness": ("Tshirt",),
        "cloth": ("Top", "Jumpsuit"),
        "topology": ("Jumpsuit", "Dress"),
        "all": ("Skirt", "Tshirt"),
    }
    ends_of = {
        "shape": lambda a: (at(a, shape=small), at(a, shape=large)),
        "tightness": lambda a: (
            at(a, shape=average, tightness=tightness(a, _TIGHT)),
            at(a, shape=average, tightness=tightness(a, _LOOSE)),
        ),
        "cloth": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "topology": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "all": lambda a, b: (at(a), at(b)),
    }
    return {
        name: interpolate(model, types, *ends_of[name](*needed), steps)
        for name, needed in needed_types.items()
        if all(garment in first for garment in needed)
    }


_CVAR_PARTS = {"shape": slice(0, 10), "tightness": slice(11, 13)}
