"""Which vertices of a source garment the vertices of its template follow."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.errors import InputError
from drapeline.storage import load_npz


class RemeshTable(NamedTuple):
    """Where each template vertex lies on a source garment.

    Attributes:
        corners: (N, 3) int32 source vertices.
        shares: (N, 3) float32, rows sum to 1.
    """

    corners: np.ndarray
    shares: np.ndarray


def remesh(cloth: np.ndarray, table: RemeshTable) -> np.ndarray:
    """Move source vertices (..., V, 3) of any frame to the template's topology: (..., N, 3)."""
    return (cloth[..., table.corners, :] * table.shares[..., None]).sum(axis=-2)


def load_tables(folders: Iterable[str | Path], garment: str) -> dict[str, RemeshTable]:
    """Remesh tables of one type's garments, by the name of their outfit or sample.

    Args:
        folders: written by `write_tables`.
        garment: the type.

    Raises:
        InputError: a file is missing or a garment lacks one of the two arrays.
    """
    found = {}
    for folder in folders:
        path = Path(folder) / f"{garment}.npz"
        arrays = load_npz(path, {"*/corners": "int * 3", "*/shares": "float * 3"})
        for name in dict.fromkeys(key.rpartition("/")[0] for key in arrays):
            for key in RemeshTable._fields:
                if f"{name}/{key}" not in arrays:
                    raise InputError(f"{path}: lacks {name}/{key}, expected it for every garment")
            found[name] = RemeshTable(*(arrays[f"{name}/{key}"] for key in RemeshTable._fields))
    return found
