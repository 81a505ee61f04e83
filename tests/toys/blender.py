"""Sheets of cloth over a ball, simulated by Blender."""

from drapeline.blender.cloth import BlenderCloth
from toys import sheets as sheet_toys


def drop(
    tmp_path,
    garments,
    frames,
    *,
    path=sheet_toys.still,
    radius=0.1,
    steps=8,
    floor_m=None,
    **numbers,
):
    """As `sheet_toys.drop`, with numbers of `BlenderCloth`."""
    solver = BlenderCloth(**numbers)
    return sheet_toys.drop(
        tmp_path, solver, garments, frames, path=path, radius=radius, steps=steps, floor_m=floor_m
    )
