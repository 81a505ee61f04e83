"""Garments that models leave for figures, beside their truth, and files of whole fits.

Fits to scans are scan's name -> variant -> garment type -> posed triangles. The labels of a fitted
picture's pixels are 0 background, 1 body, 2 unknown, 3 + index into `GARMENTS`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, load_record, save_npz, save_record

TRUE, BODY = "true", "body"  # what figures show besides fits

# Variant -> garment type, or `BODY` -> posed triangles. The variant `BODY` has the body that is
# shown where a variant has none of its own.
Fits = Mapping[str, Mapping[str, Mesh]]


_FIT_ARRAYS = {"keys": "str n", "*/vertices": "float * 3", "*/faces": "int * 3"}
BODY_PIXEL, UNKNOWN_PIXEL, FIRST_GARMENT_PIXEL = 1, 2, 3
_PICTURE_ARRAYS = {
    "name": "str",
    "labels": "int h w",
    "photo": "int * * 3",
    "people": "int",
    "*/intrinsics": "number 3 3",
    "*/world_to_camera": "number 4 4",
    "*/vertices": "float * 3",
    "*/faces": "int * 3",
    "*/garments": "str *",
    "*/true": "str *",
    "*/rest": "str *",
}


class GarmentCase(NamedTuple):
    """A garment before registration, after it, and as predicted."""

    label: str  # its name in a picture
    original: Mesh  # the garment as made or simulated, triangles, root-relative metres
    true: np.ndarray  # (V, 3) registered vertices, garment within `mask` (V,)
    mask: np.ndarray  # (V,) bool
    predicted: np.ndarray  # (V, 3)
    predicted_mask: np.ndarray  # (V,) bool; the true one if the model predicts none
    faces: np.ndarray  # (F, 3) of the garment's topology
    wearer: Mesh  # the whole body in the same pose
    root_rotation: np.ndarray  # (3,) axis-angle of the wearer's root joint, rad


class WornGarment(NamedTuple):
    """A garment on its wearer."""

    garment_type: str  # one of `GARMENTS`
    garment: Mesh  # metres, in the frame of its wearer
    wearer: Mesh  # the whole body in the same pose
    root_rotation: np.ndarray  # (3,) axis-angle of the wearer's root joint, rad


class RebuiltGarment(NamedTuple):
    """A held-out garment with its surfaces, all at rest."""

    label: str
    garment: str
    original: Mesh  # as it was made
    # sheet, walls: of the field of its code.
    sheet: Mesh
    walls: Mesh
    mean: Mesh  # the open surface of the mean code on the same body
    wearer: Mesh


class GalleryGarment(NamedTuple):
    """A garment of a gallery of SMPLicit."""

    sheet: str  # the picture that it is part of
    # row, column: its place there, by their titles, which may have several lines.
    row: str
    column: str
    caption: str
    garment: str  # its type, one of `GARMENTS`
    mesh: Mesh  # triangles at rest, root-relative metres; no faces if nothing was made
    wearer: Mesh  # the whole body at rest


@dataclass(frozen=True)
class Reconstruction:
    """Frames of a sequence with every step of their reconstruction, for pictures.

    All vertices are in metres and relative to the root joint, Z up.
    """

    name: str
    garment: str
    faces: Annotated[np.ndarray, "int<n * 3"]  # of the garment's template
    canonical: Annotated[np.ndarray, "float n 3"]  # as estimated
    # The canonical garment skinned: equation 1 without displacements.
    proposal: Annotated[np.ndarray, "float f n 3"]
    final: Annotated[np.ndarray, "float f n 3"]  # with them
    true: Annotated[np.ndarray, "float ..."]  # (F, N, 3), or no frames without ground truth
    true_canonical: Annotated[np.ndarray, "float ..."]  # (N, 3), or no vertices
    points: Annotated[np.ndarray, "float f p 3"]  # input clouds
    labels: Annotated[np.ndarray, "int f p"]  # predicted indices into `LABELS`
    body: Annotated[np.ndarray, "float f v 3"]  # whole
    rest_body: Annotated[np.ndarray, "float v 3"]  # in the pose of the canonical garment
    body_faces: Annotated[np.ndarray, "int<v * 3"]
    root_rotation: Annotated[np.ndarray, "float f 3"]  # axis-angle of the body's root joint, rad
    root_height: Annotated[np.ndarray, "float f"]  # metres of the root joint above the floor
    number: Annotated[np.ndarray, "int f"]  # of the frames in their sequence, rising

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_record(path, self)


def load_reconstruction(path: str | Path) -> Reconstruction:
    """Read what `Reconstruction.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return load_record(path, Reconstruction)


def first_reconstructions(folders: Iterable[str | Path]) -> list[tuple[Path, Path]]:
    """Of each type the first test sequence; names of simulated ones come before the others'.

    Args:
        folders: of an evaluation per type.

    Returns:
        The files of the paper's network and of ours, for every type that has any.

    Raises:
        InputError: no type has one.
    """
    folders = list(folders)
    ours = [
        path
        for folder in folders
        for path in sorted(Path(folder).glob("reconstructions/*_ours.npz"))[:1]
    ]
    if not ours:
        raise InputError(
            f"{folders[0]}: no sequence of any type is in the test split, expected one or"
            " more; ask for more samples or for a larger share"
        )
    return [(path.with_name(path.name.replace("_ours", "")), path) for path in ours]


# Of a model's evaluation on scans.
FITTED = "fitted_scans.npz"


def save_fitted_scans(path: str | Path, found: Mapping[str, Fits]) -> None:
    """Write scan's name -> fits, which `load_fitted_scans` reads."""
    arrays, keys = {}, []
    for scan, variants in found.items():
        for variant, garments in variants.items():
            for name, mesh in garments.items():
                key = f"{scan}/{variant}/{name}"
                keys.append(key)
                arrays[f"{key}/vertices"] = mesh.vertices.astype(np.float32)
                arrays[f"{key}/faces"] = mesh.faces.astype(np.int32)
    save_npz(path, keys=np.array(keys, dtype=np.str_), **arrays)


def load_fitted_scans(path: str | Path) -> dict[str, dict[str, dict[str, Mesh]]]:
    """Read what `save_fitted_scans` wrote.

    Raises:
        InputError: the file is missing, lacks an array or names none of a fit.
    """
    arrays = load_npz(path, _FIT_ARRAYS)
    found: dict[str, dict[str, dict[str, Mesh]]] = {}
    for key in map(str, arrays["keys"]):
        if key.count("/") != 2:
            raise InputError(f"{path}: names a fit '{key:.80}', expected scan/variant/garment")
        scan, variant, name = key.split("/")
        mesh = Mesh(arrays[f"{key}/vertices"], arrays[f"{key}/faces"])
        found.setdefault(scan, {}).setdefault(variant, {})[name] = mesh
    return found


@dataclass(frozen=True)
class PersonShown:
    """A person of a picture, in the world of the camera."""

    intrinsics: np.ndarray  # (3, 3) of the camera, pixels
    world_to_camera: np.ndarray  # (4, 4), metres
    body: Mesh  # posed
    garments: Mapping[str, Mesh]  # type -> posed sheet, from the innermost to the outermost
    # Type -> the garment that the picture was taken of; empty where nobody knows.
    true: Mapping[str, Mesh]
    # Type -> its sheet at rest, root-relative metres.
    rest: Mapping[str, Mesh] = field(default_factory=dict)


@dataclass(frozen=True)
class FittedPicture:
    """A picture and what was found in it."""

    name: str
    labels: np.ndarray  # (H, W) uint8, see above
    photo: np.ndarray | None  # (H, W, 3) uint8, or None
    people: tuple[PersonShown, ...]

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        arrays: dict[str, np.ndarray] = {}
        for number, person in enumerate(self.people):
            arrays[f"{number}/intrinsics"] = person.intrinsics
            arrays[f"{number}/world_to_camera"] = person.world_to_camera
            meshes = {"body": person.body}
            for kind in ("garments", "true", "rest"):
                found = getattr(person, kind)
                arrays[f"{number}/{kind}"] = np.array([*found], dtype=np.str_)
                meshes |= {f"{kind}/{name}": mesh for name, mesh in found.items()}
            for name, mesh in meshes.items():
                arrays[f"{number}/{name}/vertices"] = mesh.vertices.astype(np.float32)
                arrays[f"{number}/{name}/faces"] = mesh.faces.astype(np.int32)
        photo = np.zeros((0, 0, 3), np.uint8) if self.photo is None else self.photo
        count = len(self.people)
        save_npz(path, name=self.name, labels=self.labels, photo=photo, people=count, **arrays)


def load_fitted_picture(path: str | Path) -> FittedPicture:
    """Read what `FittedPicture.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(path, _PICTURE_ARRAYS)
    photo = arrays["photo"]
    return FittedPicture(
        str(arrays["name"]),
        arrays["labels"],
        photo if photo.size else None,
        tuple(_person(arrays, number) for number in range(int(arrays["people"]))),
    )


def _person(arrays: Mapping[str, np.ndarray], number: int) -> PersonShown:
    def mesh(name: str) -> Mesh:
        return Mesh(arrays[f"{number}/{name}/vertices"], arrays[f"{number}/{name}/faces"])

    def meshes(kind: str) -> dict[str, Mesh]:
        return {str(name): mesh(f"{kind}/{name}") for name in arrays[f"{number}/{kind}"]}

    return PersonShown(
        arrays[f"{number}/intrinsics"],
        arrays[f"{number}/world_to_camera"],
        mesh("body"),
        meshes("garments"),
        meshes("true"),
        meshes("rest"),
    )


def label_of(garment: str) -> int:
    """The label of a garment type's pixels."""
    return FIRST_GARMENT_PIXEL + GARMENTS.index(garment)
