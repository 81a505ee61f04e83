"""Dressed people from pictures: codes, sheets at rest, and sheets worn in layers (SMPLicit 4.3)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.models.pictures.dressed import FittedGarment, posed_person
from drapeline.models.pictures.read import GARMENT_CLASSES, Person, Picture
from drapeline.models.smplicit.dressing import BodyShape, decode_worn
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.fit import (
    SeenPoints,
    fit_garments,
    rank_codes,
    seen_points,
    skinning_options,
    space_points,
)
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.models.smplicit.surface.fields import REACH_M
from drapeline.rendering.camera import Camera
from drapeline.seeding import rng_for

MODEL_OF_CLASS = {name: MODEL_OF_GARMENT[garment] for name, garment in GARMENT_CLASSES.items()}
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
    upper = MODEL_OF_CLASS[name] == "upper"
    return model.codes.z if upper else model.codes_of(GARMENT_CLASSES[name])


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
    missing = {MODEL_OF_CLASS[name] for _, name in wanted} - set(models)
    if missing:
        raise InputError(
            f"{picture.name}: shows garments of the model {min(missing)}, expected only those of"
            f" {', '.join(models)}"
        )
    own_bodies = next(iter(models.values())).bodies
    bodies = [posed_person(person, own_bodies) for person in picture.people]
    codes: dict[tuple[int, str], np.ndarray] = {}
    for kind in dict.fromkeys(name for _, name in wanted):
        model = models[MODEL_OF_CLASS[kind]]
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
            {name: (models[MODEL_OF_CLASS[name]], codes[i, name]) for name in person.garments},
            skinning_options(settings),
            meshing,
        )
        for i, (person, body) in enumerate(zip(picture.people, bodies, strict=True))
    ]


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
