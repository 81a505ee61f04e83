"""All models compared: the same held-out garments through each representation."""

from collections.abc import Iterable, Sequence

import numpy as np

from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.learning_data.static import StaticData
from drapeline.metrics.garment import area_distances_mm
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import join, summarise
from drapeline.models.contract import HeldOutGarment, Representation
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import StaticOutfit
from drapeline.rule_log import progress
from drapeline.schema import Table

MODEL = "representation"


def held_out_garments(
    data: StaticData, outfits: Iterable[StaticOutfit], types: Sequence[str], split: str
) -> list[HeldOutGarment]:
    """The garments of some types in a split, in the order of the dataset's rows.

    Args:
        data: registered to the body.
        outfits: the same garments as they were made, among others.
        types: of `GARMENTS`.
        split: "val" or "test".
    """
    rows = data.rows(split)
    rows = rows[np.isin(data.garment[rows], [GARMENTS.index(name) for name in types])]
    found = {int(row): (str(data.outfit[row]), GARMENTS[data.garment[row]]) for row in rows}
    wanted = {names: row for row, names in found.items()}
    meshes = {
        wanted[name, garment.name]: Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
        if (name, garment.name) in wanted
    }
    return [HeldOutGarment(row, *names, meshes[row]) for row, names in found.items()]


def compare_representations(
    garments: Sequence[HeldOutGarment],
    representations: Iterable[Representation],
    *,
    split: str,
    seed: int,
) -> Table:
    """Distances between garments as they were made and as rebuilt, and the size of each code.

    A code cannot give back what registration has lost. What a decoder knows besides the code, such
    as the body's shape, does not count towards its size.

    Args:
        garments: of `split`.
        split: named in the rows.
        seed: of the intervals.
    """
    found = []
    for representation in representations:
        variant = representation.variant
        every = []
        rebuilt = progress(representation.rebuild(garments), total=len(garments), label=variant)
        for garment, mesh in zip(garments, rebuilt, strict=True):
            to_true, to_rebuilt = area_distances_mm(mesh, garment.mesh)
            measured = {"surface_to_true_mm": to_true, "true_to_surface_mm": to_rebuilt}
            numbers = representation.code_numbers(garment.garment)
            if numbers is not None:
                measured["code_numbers"] = numbers
            every.append(Measured(garment.outfit, garment.garment, measured))
        how = {"model": MODEL, "variant": variant, "split": split, "seed": seed}
        found.append(summarise(every, **how, by_source=False))
    return join(found)
