"""People of pictures, dressed in what a model has found: worn, draped, written and shown."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from drapeline.bodies.follow import PosedBody, pose_body
from drapeline.bodies.model import BodyModel
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.metrics.predictions import FittedPicture, PersonShown, label_of
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES, Person, Picture
from drapeline.outfits.worn import DrapedSheet
from drapeline.rendering.camera import Camera
from drapeline.rendering.modalities import cast_rays
from drapeline.storage import atomic_folder, save_npz, write_rows


class FittedGarment(NamedTuple):
    """A garment that a picture or a scan shows.

    Attributes:
        z: (Z,) its code.
        sheet: at rest, root-relative metres, Z up; no faces if nothing is left of it.
        posed: as it is worn, in the world of the camera or of the scan.
    """

    z: np.ndarray
    sheet: Mesh
    posed: Mesh


class Draper(Protocol):
    """Drapes sheets on people, see `drapeline.generation.moving_sheets.SolverDraper`."""

    def __call__(
        self,
        sheets: Mapping[str, Mesh],
        body: BodyModel,
        gender: str,
        shape: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        up: np.ndarray,
    ) -> dict[str, DrapedSheet]:
        """Sheets by garment type as they hang; none if that failed."""
        ...


def use_draped(
    outfit: Mapping[str, FittedGarment], draped: Mapping[str, DrapedSheet]
) -> dict[str, FittedGarment]:
    """Garments as they hang; those that do not, as they are."""
    return {
        name: garment._replace(sheet=draped[name].rest, posed=draped[name].posed)
        if name in draped
        else garment
        for name, garment in outfit.items()
    }


def posed_person(person: Person, bodies: Mapping[str, BodyModel]) -> PosedBody:
    """The body of a person in a picture, at rest and posed; bodies are by gender."""
    return pose_body(bodies[person.gender], person.shape, person.pose, person.trans)


def drape_sheets(
    outfit: Mapping[str, FittedGarment],
    person: Person,
    bodies: Mapping[str, BodyModel],
    draper: Draper,
) -> dict[str, DrapedSheet]:
    """Class -> a person's sheet as it hangs; none if that fails.

    What is upright in the picture is taken for upright.
    """
    draped = draper(
        {GARMENT_CLASSES[name]: garment.sheet for name, garment in outfit.items()},
        bodies[person.gender],
        person.gender,
        person.shape,
        person.pose,
        person.trans,
        -person.camera.axes[1],
    )
    return {
        name: draped[GARMENT_CLASSES[name]] for name in outfit if GARMENT_CLASSES[name] in draped
    }


def drape_outfit(
    outfit: Mapping[str, FittedGarment],
    person: Person,
    bodies: Mapping[str, BodyModel],
    draper: Draper,
) -> dict[str, FittedGarment]:
    """The garments of a person as they hang; nothing if that fails."""
    draped = drape_sheets(outfit, person, bodies, draper)
    return use_draped(outfit, draped) if draped else {}


def seen_parts(body: PosedBody, garments: Sequence[Mesh], camera: Camera) -> np.ndarray:
    """(H, W) what a camera sees of a dressed body: 0 nothing, 1 skin, 2 and so on a garment."""
    meshes = [(body.posed, body.faces), *((m.vertices, m.faces) for m in garments)]
    numbers = [number for number, (_, faces) in enumerate(meshes, 1) if len(faces)]
    cast = [(v, f, np.zeros_like(v)) for v, f in meshes if len(f)]
    return np.array([0, *numbers])[cast_rays(cast, camera).segments]


def write_fitted(
    folder: str | Path, picture: Picture, people: Sequence[Mapping[str, FittedGarment]]
) -> None:
    """Write what was found in a picture.

    For each garment `person1_upper_rest.obj` and `person1_upper.obj`, posed; codes in `codes.npz`;
    and `garments.tsv` with a row for each.

    Args:
        folder: to write; replaces an earlier one.
        people: class -> garment of each person, from the innermost to the outermost.
    """
    rows, codes = [], {}
    with atomic_folder(folder) as scratch:
        for number, (person, outfit) in enumerate(zip(picture.people, people, strict=True), 1):
            for name, garment in outfit.items():
                stem = f"person{number}_{name}"
                save_obj(scratch / f"{stem}_rest.obj", garment.sheet)
                save_obj(scratch / f"{stem}.obj", garment.posed)
                codes[stem] = garment.z
                shown = picture.shows(person, name)
                rows.append(
                    {
                        "person": number,
                        "gender": person.gender,
                        "garment": name,
                        "pixels": int(shown.sum()),
                        "vertices": len(garment.sheet.vertices),
                        "faces": len(garment.sheet.faces),
                    }
                )
        save_npz(scratch / "codes.npz", **codes)
        write_rows(scratch / "garments.tsv", rows)


def shown_picture(
    picture: Picture,
    bodies: Mapping[str, BodyModel],
    people: Sequence[Mapping[str, FittedGarment]],
) -> FittedPicture:
    """A picture and what was found in it, for figures.

    Args:
        bodies: by gender, that its people have.
        people: see `write_fitted`.
    """
    shown = []
    for person, outfit in zip(picture.people, people, strict=True):
        posed = {GARMENT_CLASSES[name]: found.posed for name, found in outfit.items()}
        rest = {GARMENT_CLASSES[name]: found.sheet for name, found in outfit.items()}
        shown.append(shown_person(person, posed_person(person, bodies), posed, {}, rest))
    return FittedPicture(picture.name, shown_labels(picture.classes), picture.photo, tuple(shown))


def shown_person(
    person: Person,
    body: PosedBody,
    garments: Mapping[str, Mesh],
    true: Mapping[str, Mesh],
    rest: Mapping[str, Mesh],
) -> PersonShown:
    """A person of a figure; see `PersonShown`."""
    camera = person.camera
    posed = Mesh(body.posed.astype(np.float32), body.faces)
    return PersonShown(camera.intrinsics, camera.world_to_camera, posed, garments, true, rest)


def shown_labels(classes: np.ndarray) -> np.ndarray:
    """(H, W) labels of `metrics.predictions` of indices into `CLASSES`."""
    table = [
        index if name not in GARMENT_CLASSES else label_of(GARMENT_CLASSES[name])
        for index, name in enumerate(CLASSES)
    ]
    return np.array(table, dtype=np.uint8)[classes]
