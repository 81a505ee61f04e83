"""Garments as codes of distance fields."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from drapeline.geometry.mesh import Mesh
from drapeline.models.contract import HeldOutGarment
from drapeline.models.smplicit.held_out import load_held_out


class FieldCode:
    """The code fitted to a garment's field, and the open surface of the field of the code.

    Args:
        paths: files of the rule `evaluate_smplicit`, which hold both.

    Raises:
        InputError: a file is missing or lacks an array.
    """

    variant = "smplicit"

    def __init__(self, paths: Sequence[str | Path]) -> None:
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
