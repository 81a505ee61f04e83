"""What is known of a written sample from its `meta.json` and its file sizes; body identity."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drapeline.errors import InputError
from drapeline.storage import read_json

if TYPE_CHECKING:
    from drapeline.bodies.model import BodyModel

_SHARED = (".mat", ".obj", ".pc16", ".png")  # what a CLOTH3D sample holds; the rest is ours


@dataclass(frozen=True)
class SampleRecord:
    """A sample's folder, its `meta.json` and the size of its files.

    Attributes:
        folder: the sample's folder.
        meta: its `meta.json`.
        cloth3d_bytes: bytes of the files that CLOTH3D stores too.
        total_bytes: bytes of all its files.
    """

    folder: Path
    meta: Mapping[str, Any]
    cloth3d_bytes: int
    total_bytes: int

    @property
    def accepted(self) -> bool:
        """Whether it is part of the dataset."""
        return self.meta["status"] == "accepted"


def read_record(folder: str | Path) -> SampleRecord:
    """Read a sample's `meta.json` and measure its files.

    Raises:
        InputError: it has no `meta.json`, or one that lacks what every sample has.
    """
    folder = Path(folder)
    meta = read_json(folder / "meta.json")
    missing = [key for key in ("id", "status", "split", "motion", "outfit") if key not in meta]
    if missing:
        raise InputError(f"{folder / 'meta.json'}: lacks {', '.join(missing)}")
    sizes = {path: path.stat().st_size for path in folder.iterdir()}
    shared = [
        size
        for path, size in sizes.items()
        if path.suffix in _SHARED and path.stem in {"info", *meta.get("garments", {})}
    ]
    return SampleRecord(folder, meta, sum(shared), sum(sizes.values()))


def body_fingerprint(body: "BodyModel") -> str:
    """SHA-256 of the arrays that decide where a posed body is; tells two body files apart."""
    digest = hashlib.sha256()
    for array in (body.v_template, body.shapedirs, body.posedirs, body.J_regressor, body.weights):
        digest.update(np.ascontiguousarray(array, dtype="<f4").data)
    digest.update(np.ascontiguousarray(body.faces, dtype="<i4").data)
    return digest.hexdigest()
