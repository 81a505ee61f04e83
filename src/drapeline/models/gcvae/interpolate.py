"""Straight ways through codes and conditions, decoded step by step (CLOTH3D figure 9)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh
from drapeline.models.gcvae.codes import Codes, StaticGarments, rest_body
from drapeline.models.gcvae.sample import GarmentTypes, decode_typed, faces_of
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS

_SHAPE_SPAN, _TIGHT, _LOOSE = 2.5, 0.5, -1.5


class Step(NamedTuple):
    """A garment on a way.

    Attributes:
        garment: as decoded, in rest pose.
        cvar: (13,) conditions it was decoded with.
        type: index into `GARMENTS` of what it is most like.
    """

    garment: Mesh
    cvar: np.ndarray
    type: int


def walk(
    model: StaticVae,
    types: GarmentTypes,
    start: tuple[np.ndarray, np.ndarray],
    end: tuple[np.ndarray, np.ndarray],
    steps: int,
) -> list[Step]:
    """Decode evenly spaced points between two pairs of code (Z,) and conditions (13,).

    The topology of each point is that of the type that it is most like.
    """
    share = np.linspace(0, 1, steps)[:, None]
    z, cvar = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    out = []
    for (kind, offsets, mask), condition in zip(
        decode_typed(model, types, z, cvar, [None] * steps), cvar, strict=True
    ):
        vertices = rest_body(model, condition) + offsets
        out.append(Step(garment_mesh(vertices, faces_of(model, kind), mask), condition, kind))
    return out


def paper_walks(
    model: StaticVae,
    types: GarmentTypes,
    garments: StaticGarments,
    rows: np.ndarray,
    codes: Codes,
    steps: int,
) -> dict[str, list[Step]]:
    """The rows of figure 9: shape, tightness, cloth, cloth across topologies, and all at once.

    Args:
        rows: (n,) garments to begin and end at, the first of each type; a way that needs a type
            that is not among them is left out.
        codes: their (n, Z) codes.

    Returns:
        What changes -> steps.
    """
    kinds = np.asarray(garments.garment)[rows]
    cvar = garments.cvar(rows)
    first: Mapping[str, int] = {
        name: int(np.flatnonzero(kinds == index)[0])
        for index, name in enumerate(GARMENTS)
        if (kinds == index).any()
    }

    def at(name: str, **changed: object) -> tuple[np.ndarray, np.ndarray]:
        """A garment's code and conditions, with another shape or tightness."""
        condition = cvar[first[name]].copy()
        for part, value in changed.items():
            condition[_PLACES[part]] = value
        return codes.mean[first[name]], condition

    def tightness(name: str, value: float) -> list[float]:
        female = cvar[first[name]][10] == 0
        return [-value if female else value, value]

    average = np.zeros(10)
    ends = np.zeros((2, 10))
    ends[:, 0] = ends[:, 1] = (-_SHAPE_SPAN, _SHAPE_SPAN)
    ways: dict[str, tuple[str, ...]] = {
        "shape": ("Dress",),
        "tightness": ("Tshirt",),
        "cloth": ("Top", "Jumpsuit"),
        "topology": ("Jumpsuit", "Dress"),
        "all": ("Skirt", "Tshirt"),
    }
    made = {
        "shape": lambda a: (at(a, shape=ends[0]), at(a, shape=ends[1])),
        "tightness": lambda a: (
            at(a, shape=average, tightness=tightness(a, _TIGHT)),
            at(a, shape=average, tightness=tightness(a, _LOOSE)),
        ),
        "cloth": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "topology": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "all": lambda a, b: (at(a), at(b)),
    }
    return {
        name: walk(model, types, *made[name](*needed), steps)
        for name, needed in ways.items()
        if all(kind in first for kind in needed)
    }


_PLACES = {"shape": slice(0, 10), "tightness": slice(11, 13)}
