"""Dressed people from pictures: codes, sheets at rest, and sheets worn in layers (SMPLicit 4.3)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody, pose_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.metrics.predictions import FittedPicture, PersonShown, label_of
from drapeline.models.smplicit.dressing import BodyShape, FittedGarment, decode_worn
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.fit import (
    SeenPoints,
    fit_garments,
    rank_codes,
    seen_points,
    skinning_options,
    space_points,
)
from drapeline.models.smplicit.pictures.read import CLASSES, GARMENT_CLASSES, Person, Picture
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.models.smplicit.surface.fields import REACH_M
from drapeline.rendering.camera import Camera
from drapeline.rendering.modalities import cast_rays
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, save_npz, write_rows

# No garment at rest is further from the body; tops and trousers are closer than those with skirts.
_REACH_M = {"upper": 0.17, "trousers": 0.17, "skirt": REACH_M, "whole": REACH_M}


class GarmentView(NamedTuple):
    """A garment as a picture shows it."""

    shown: np.ndarray  # (H, W) bool, where it is seen
    unsure: np.ndarray  # (H, W) bool, pixels that tell nothing about it
    camera: Camera  # of the picture
    body: PosedBody  # the wearer, at rest and posed


class Observation(NamedTuple):
    """A garment that is looked for in a picture."""

    model: SmplicitModel  # of the garment
    # (n, cut + style) of the training garments that starts and the prior are taken from.
    codes: np.ndarray
    view: GarmentView  # of it
    name: str  # for errors, and for the seeds of its points


def observe_points(
    model: SmplicitModel, view: GarmentView, settings: FitImage, rng: np.random.Generator, name: str
) -> SeenPoints:
    """Points of the space of a model's garments, and what a view tells about them.

    Raises:
        InputError: the images are not of the camera's size, no pixel shows the garment, or none of
            those that do is near the body.
    """
    size = (view.camera.height, view.camera.width)
    for image in (view.shown, view.unsure):
        if image.shape != size:
            raise InputError(
                f"{name}: the image has {image.shape[1]} x {image.shape[0]} pixels, expected"
                f" {size[1]} x {size[0]} as the camera's"
            )
    if not view.shown.any():
        raise InputError(f"{name}: no pixel shows it, expected some")
    low, high = np.asarray(model.box)
    reach = _REACH_M[model.name]
    space = space_points(rng, view.body, (low, high), count=settings.points, reach_m=reach)
    seen = seen_points(
        space,
        view.body,
        view.camera,
        view.shown,
        view.unsure,
        neighbours=settings.neighbours,
        ray_m=settings.ray_m,
    )
    if not len(seen.on) or not len(seen.off):
        raise InputError(
            f"{name}: {len(seen.on.points)} points around the body are on its pixels and"
            f" {len(seen.off.points)} beside them, expected some of both; do body and camera belong"
            " to the picture?"
        )
    return seen


def codes_of_class(model: SmplicitModel, name: str) -> np.ndarray:
    """(n, cut + style) training codes of what a class may be: for upper bodies, of any type."""
    key, garment = GARMENT_CLASSES[name]
    return model.codes.z if key == "upper" else model.codes_of(garment)


def fit_codes_to_views(
    model: SmplicitModel,
    codes: np.ndarray,
    views: Sequence[GarmentView],
    wearers: Sequence[BodyShape],
    names: Sequence[str],
    settings: FitImage,
    seed: int,
) -> np.ndarray:
    """(B, cut + style) codes of garments of one model, fitted together.

    Args:
        model: of all of them.
        codes: (n, cut + style) of the training garments that starts and the prior are taken from.
        views, wearers, names, settings, seed: see `observe_garments`, as for errors.
    """
    seen, places = observe_garments(model, views, wearers, names, settings, seed)
    rng = rng_for(seed, "evidence", *names)
    return fit_garments(model.network, codes, seen, places, settings, rng).numpy()


def observe_garments(
    model: SmplicitModel,
    views: Sequence[GarmentView],
    wearers: Sequence[BodyShape],
    names: Sequence[str],
    settings: FitImage,
    seed: int,
) -> tuple[list[SeenPoints], torch.Tensor]:
    """Points that views of garments of one model tell about, and the wearers' clusters (B, K, 3).

    Args:
        model: of all of them.
        views, wearers, names: of each.
        seed: of the points; a garment's do not depend on the others'.

    Raises:
        InputError: see `observe_points`.
    """
    seen = [
        observe_points(model, view, settings, rng_for(seed, "space", name), name)
        for view, name in zip(views, names, strict=True)
    ]
    with torch.no_grad():
        places = model.network.places(
            torch.tensor(np.stack([w.shape for w in wearers]), dtype=torch.float32),
            torch.tensor([GENDERS.index(w.gender) for w in wearers]),
        )
    return seen, places


def fit_picture(
    picture: Picture,
    models: Mapping[str, SmplicitModel],
    settings: FitImage,
    meshing: Meshing,
    seed: int,
) -> list[dict[str, FittedGarment]]:
    """The garments of all people of a picture, by class, from the innermost to the outermost.

    Args:
        models: by their names of `FIELD_MODELS`.

    Raises:
        InputError: a model is missing, or a garment cannot be fitted; see `observe_points`.
    """
    wanted = [(i, name) for i, one in enumerate(picture.people) for name in one.garments]
    missing = {GARMENT_CLASSES[name].model for _, name in wanted} - set(models)
    if missing:
        raise InputError(
            f"{picture.name}: shows garments of the model {min(missing)}, expected only those of"
            f" {', '.join(models)}"
        )
    bodies = [posed_person(person, models) for person in picture.people]
    codes: dict[tuple[int, str], np.ndarray] = {}
    for kind in dict.fromkeys(name for _, name in wanted):
        model = models[GARMENT_CLASSES[kind].model]
        own = [(i, name) for i, name in wanted if name == kind]
        observed = [observe(picture, i, kind, model, bodies[i]) for i, _ in own]
        wearers = [BodyShape(picture.people[i].gender, picture.people[i].shape) for i, _ in own]
        views, names = [one.view for one in observed], [one.name for one in observed]
        known = observed[0].codes
        found = fit_codes_to_views(model, known, views, wearers, names, settings, seed)
        codes.update(zip(own, found, strict=True))
    return [
        decode_worn(
            body,
            BodyShape(person.gender, person.shape),
            {
                name: (models[GARMENT_CLASSES[name].model], codes[i, name])
                for name in person.garments
            },
            skinning_options(settings),
            meshing,
        )
        for i, (person, body) in enumerate(zip(picture.people, bodies, strict=True))
    ]


def posed_person(person: Person, models: Mapping[str, SmplicitModel]) -> PosedBody:
    """The body of a person in a picture, at rest and posed."""
    body = next(iter(models.values())).bodies[person.gender]
    return pose_body(body, person.shape, person.pose, person.trans)


def observe(
    picture: Picture, index: int, name: str, model: SmplicitModel, body: PosedBody
) -> Observation:
    """A class of garments on the picture's person of that number."""
    view = garment_view(picture, picture.people[index], name, body)
    label = f"{picture.name}, person {index + 1}, {name}"
    return Observation(model, codes_of_class(model, name), view, label)


def garment_view(picture: Picture, person: Person, name: str, body: PosedBody) -> GarmentView:
    """The view that a picture gives of a class of garments on a person."""
    return GarmentView(
        picture.shows(person, name), picture.unsure(person, name), person.camera, body
    )


def decode_nearest(
    observed: Mapping[str, Observation],
    wearer: BodyShape,
    settings: FitImage,
    meshing: Meshing,
    seed: int,
) -> dict[str, FittedGarment]:
    """Of each garment in a picture the training code with the least loss, worn in layers.

    Garments are observed from the innermost to the outermost; for the rest see `fit_picture`.
    """
    codes = {}
    for name, (model, every, view, label) in observed.items():
        (seen,), (places,) = observe_garments(model, [view], [wearer], [label], settings, seed)
        rng = rng_for(seed, "nearest", label)
        ranked = rank_codes(model.network, seen, places, every, settings, rng)
        codes[name] = model, every[ranked[0]]
    body = next(iter(observed.values())).view.body
    return decode_worn(body, wearer, codes, skinning_options(settings), meshing)


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
        people: what `fit_picture` found.
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
    models: Mapping[str, SmplicitModel],
    people: Sequence[Mapping[str, FittedGarment]],
) -> FittedPicture:
    """A picture, the models it was looked at with, and what `fit_picture` found, for figures."""
    shown = []
    for person, outfit in zip(picture.people, people, strict=True):
        body = posed_person(person, models)
        garments = {GARMENT_CLASSES[name].garment: found.posed for name, found in outfit.items()}
        shown.append(shown_person(person, body, garments, {}))
    return FittedPicture(picture.name, shown_labels(picture.classes), picture.photo, tuple(shown))


def shown_person(
    person: Person, body: PosedBody, garments: Mapping[str, Mesh], true: Mapping[str, Mesh]
) -> PersonShown:
    """A person of a figure; see `PersonShown`."""
    camera = person.camera
    posed = Mesh(body.posed.astype(np.float32), body.faces)
    return PersonShown(camera.intrinsics, camera.world_to_camera, posed, garments, true)


def shown_labels(classes: np.ndarray) -> np.ndarray:
    """(H, W) labels of `metrics.predictions` of indices into `CLASSES`."""
    table = [
        index if name not in GARMENT_CLASSES else label_of(GARMENT_CLASSES[name].garment)
        for index, name in enumerate(CLASSES)
    ]
    return np.array(table, dtype=np.uint8)[classes]
