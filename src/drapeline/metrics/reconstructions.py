"""Reconstructed garment sequences in files: what figures are drawn from."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.storage import load_npz, save_npz


@dataclass(frozen=True)
class Reconstruction:
    """Frames of a sequence with every step of their reconstruction, for pictures.

    All vertices are in metres and relative to the root joint, Z up.

    Attributes:
        name: of the sequence.
        garment: its type.
        faces: (n, 3) of the garment's template.
        canonical: (N, 3) as estimated.
        proposal: (F, N, 3), the canonical garment skinned: equation 1 without displacements.
        final: (F, N, 3), with them.
        true: (F, N, 3), or no frames for a scan without ground truth.
        true_canonical: (N, 3), or no vertices.
        points: (F, P, 3) input clouds.
        labels: (F, P) predicted indices into `dataset.labels.LABELS`.
        body: (F, V, 3) whole body.
        rest_body: (V, 3) in the pose of the canonical garment.
        body_faces: (f, 3).
        root_rotation: (F, 3) axis-angle of the body's root joint, rad.
        root_height: (F,) metres of the root joint above the floor.
        number: (F,) of the frames in their sequence, rising.
    """

    name: str
    garment: str
    faces: np.ndarray
    canonical: np.ndarray
    proposal: np.ndarray
    final: np.ndarray
    true: np.ndarray
    true_canonical: np.ndarray
    points: np.ndarray
    labels: np.ndarray
    body: np.ndarray
    rest_body: np.ndarray
    body_faces: np.ndarray
    root_rotation: np.ndarray
    root_height: np.ndarray
    number: np.ndarray

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_npz(path, **vars(self))


_ARRAYS = {
    **dict.fromkeys(("name", "garment"), "str"),
    "faces": "int<n * 3",
    "canonical": "float n 3",
    **dict.fromkeys(("proposal", "final"), "float f n 3"),
    "true": "float ...",
    "true_canonical": "float ...",
    "points": "float f p 3",
    "labels": "int f p",
    "body": "float f v 3",
    "rest_body": "float v 3",
    "body_faces": "int<v * 3",
    "root_rotation": "float f 3",
    "root_height": "float f",
    "number": "int f",
}


def load_reconstruction(path: str | Path) -> Reconstruction:
    """Read what `Reconstruction.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    values = load_npz(path, _ARRAYS)
    words = {name: str(values[name]) for name in ("name", "garment")}
    return Reconstruction(**{**values, **words})


def first_reconstructions(folders: Iterable[str | Path]) -> list[tuple[Path, Path]]:
    """Of each type the first test sequence; names of simulated ones come before the others'.

    Args:
        folders: a folder of reconstructions per type.

    Returns:
        The files of the paper's network and of ours, for every type that has any.

    Raises:
        InputError: no type has one.
    """
    folders = list(folders)
    ours = [path for folder in folders for path in sorted(Path(folder).glob("*_ours.npz"))[:1]]
    if not ours:
        raise InputError(
            f"{folders[0]}: no sequence of any type is in the test split, expected one or"
            " more; ask for more samples or for a larger share"
        )
    return [(path.with_name(path.name.replace("_ours", "")), path) for path in ours]
