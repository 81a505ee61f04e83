"""Pictures of dressed people with the garments found in them, in files that figures are drawn from.

Labels of pixels: 0 background, 1 body, 2 unknown, 3 + index into `GARMENTS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, save_npz

BODY, UNKNOWN, FIRST_GARMENT = 1, 2, 3


@dataclass(frozen=True)
class PersonShown:
    """A person of a picture, in the world of the camera.

    Attributes:
        intrinsics: (3, 3) of the camera, pixels.
        world_to_camera: (4, 4), metres.
        body: posed.
        garments: type -> posed sheet, from the innermost to the outermost.
        true: type -> the garment that the picture was taken of; empty where nobody knows.
    """

    intrinsics: np.ndarray
    world_to_camera: np.ndarray
    body: Mesh
    garments: Mapping[str, Mesh]
    true: Mapping[str, Mesh]


@dataclass(frozen=True)
class FittedPicture:
    """A picture and what was found in it.

    Attributes:
        name: of the picture.
        labels: (H, W) uint8, see above.
        photo: (H, W, 3) uint8, or None.
        people: in it.
    """

    name: str
    labels: np.ndarray
    photo: np.ndarray | None
    people: tuple[PersonShown, ...]

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        arrays: dict[str, np.ndarray] = {}
        for number, person in enumerate(self.people):
            arrays[f"{number}/intrinsics"] = person.intrinsics
            arrays[f"{number}/world_to_camera"] = person.world_to_camera
            meshes = {"body": person.body}
            for kind in ("garments", "true"):
                found = getattr(person, kind)
                arrays[f"{number}/{kind}"] = np.array([*found], dtype=np.str_)
                meshes |= {f"{kind}/{name}": mesh for name, mesh in found.items()}
            for name, mesh in meshes.items():
                arrays[f"{number}/{name}/vertices"] = mesh.vertices.astype(np.float32)
                arrays[f"{number}/{name}/faces"] = mesh.faces.astype(np.int32)
        photo = np.zeros((0, 0, 3), np.uint8) if self.photo is None else self.photo
        count = len(self.people)
        save_npz(path, name=self.name, labels=self.labels, photo=photo, people=count, **arrays)


_ARRAYS = {
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
}


def load_fitted_picture(path: str | Path) -> FittedPicture:
    """Read what `FittedPicture.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(path, _ARRAYS)
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
    )


def label_of(garment: str) -> int:
    """The label of a garment type's pixels."""
    return FIRST_GARMENT + GARMENTS.index(garment)
