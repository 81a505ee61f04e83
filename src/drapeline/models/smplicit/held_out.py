"""Held-out garments as a model holds them: codes and surfaces, in files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, save_npz


@dataclass(frozen=True)
class HeldOut:
    """Garments that a model has not seen, with their codes and surfaces.

    Attributes:
        outfit: (n,) names of their outfits.
        garment: (n,) types, indices into `GARMENTS`.
        z: (n, cut + style) fitted codes.
        sheets: n open surfaces of the fitted fields.
    """

    outfit: np.ndarray
    garment: np.ndarray
    z: np.ndarray
    sheets: list[Mesh]


def save_held_out(path: str | Path, held_out: HeldOut) -> None:
    """Write codes and rebuilt surfaces, which `load_held_out` reads."""
    arrays = {}
    for index, sheet in enumerate(held_out.sheets):
        arrays[f"{index}/vertices"] = sheet.vertices.astype(np.float32)
        arrays[f"{index}/faces"] = sheet.faces.astype(np.int32)
    save_npz(
        path,
        z=held_out.z,
        outfit=held_out.outfit,
        garment=held_out.garment,
        **arrays,
    )


_ARRAYS = {
    "z": "float n *",
    "outfit": "str n",
    "garment": f"int<{len(GARMENTS)} n",
    "*/vertices": "float * 3",
    "*/faces": "int * 3",
}


def load_held_out(path: str | Path) -> dict[tuple[str, str], tuple[np.ndarray, Mesh]]:
    """(outfit, garment type) -> its code (cut + style,) and its rebuilt open surface.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(path, _ARRAYS)
    return {
        (str(outfit), GARMENTS[garment]): (
            arrays["z"][index],
            Mesh(arrays[f"{index}/vertices"], arrays[f"{index}/faces"]),
        )
        for index, (outfit, garment) in enumerate(
            zip(arrays["outfit"], arrays["garment"], strict=True)
        )
    }
