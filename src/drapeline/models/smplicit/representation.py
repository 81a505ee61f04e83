"""Held-out garments as codes of distance fields, with their surfaces, in files."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.metrics.cost import Cost, read_costs
from drapeline.metrics.shared import REPRESENTATION
from drapeline.models.compare import compare
from drapeline.models.contract import HeldOutGarment
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, save_npz


@dataclass(frozen=True)
class HeldOut:
    """Garments that a model has not seen, with their codes and surfaces."""

    outfit: np.ndarray  # (n,) names of their outfits
    garment: np.ndarray  # (n,) types, indices into `GARMENTS`
    z: np.ndarray  # (n, cut + style) fitted codes
    sheets: list[Mesh]  # n open surfaces of the fitted fields


# Of a model's evaluation.
HELD_OUT = "held_out.npz"


def save_held_out(path: str | Path, held_out: HeldOut) -> None:
    """Write codes and rebuilt surfaces, which `load_held_out` reads."""
    arrays = {}
    for index, sheet in enumerate(held_out.sheets):
        arrays[f"{index}/vertices"] = sheet.vertices.astype(np.float32)
        arrays[f"{index}/faces"] = sheet.faces.astype(np.int32)
    save_npz(path, z=held_out.z, outfit=held_out.outfit, garment=held_out.garment, **arrays)


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


class FieldCode:
    """The code fitted to a garment's field, and the open surface of the field of the code.

    Args:
        variant: named in the rows.
        paths: files of the rule `evaluate_smplicit`, which hold both.

    Raises:
        InputError: a file is missing or lacks an array.
    """

    def __init__(self, variant: str, paths: Sequence[str | Path]) -> None:
        self.variant = variant
        self._known = {key: value for path in paths for key, value in load_held_out(path).items()}

    def code_numbers(self, garment: str) -> int | None:
        """Numbers of z_cut and z_style."""
        for (_, name), (z, _) in self._known.items():
            if name == garment:
                return len(z)
        return None

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """The open surface of each garment's field."""
        for garment in garments:
            yield self._known[garment.outfit, garment.garment][1]


def compare_codes(job: Job) -> None:
    """Held-out garments as codes of SMPLicit."""
    folders = {variant: job.input[variant] for variant in job.params.variants}
    codes = [
        FieldCode(variant, [Path(folder) / HELD_OUT for folder in own])
        for variant, own in folders.items()
    ]
    compare(job, codes, [_cost(variant, own) for variant, own in folders.items()])


def _cost(variant: str, folders: Sequence[str | Path]) -> Cost:
    """The mean of what codes of several models took."""
    each = read_costs(folders)
    seconds = (each["seconds"] * each["garments"]).sum() / max(each["garments"].sum(), 1)
    garments, megabytes = int(each["garments"].sum()), each["megabytes"].max()
    return Cost(REPRESENTATION, variant, float(seconds), garments, float(megabytes))
