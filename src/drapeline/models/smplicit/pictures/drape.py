"""Garments found in pictures, draped on their wearers by a cloth solver. Ours."""

from collections.abc import Mapping, Sequence

import numpy as np

from drapeline.bodies.follow import PosedBody, add_cloth, pose_body
from drapeline.bodies.rest_body import SHAPES
from drapeline.errors import InputError
from drapeline.metrics.garment import mask_iou
from drapeline.models.pictures.dressed import (
    Draper,
    FittedGarment,
    drape_outfit,
    drape_sheets,
    posed_person,
    seen_parts,
    use_draped,
)
from drapeline.models.pictures.read import (
    Person,
    Picture,
    class_of_garment,
)
from drapeline.models.smplicit.dressing import BodyShape, decode_worn, keep_topology
from drapeline.models.smplicit.model import SmplicitModel, check_gender, finite
from drapeline.models.smplicit.pictures.fit import skinning_options
from drapeline.models.smplicit.pictures.garments import (
    MODEL_OF_CLASS,
    GarmentView,
    Observation,
    decode_nearest,
    fit_codes_to_views,
    observe,
)
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.outfits.worn import DrapedSheet
from drapeline.rendering.camera import Camera


def drape_picture(
    picture: Picture,
    people: Sequence[Mapping[str, FittedGarment]],
    models: Mapping[str, SmplicitModel],
    settings: FitImage,
    meshing: Meshing,
    seed: int,
    draper: Draper,
) -> list[dict[str, FittedGarment]]:
    """The garments of a picture as they hang on its people, with codes fitted to that.

    This is ours. Skinned cloth neither hangs nor folds, and codes that are fitted with it make up
    for that. Here the sheets hang on their wearers, points of space near them follow them from rest
    into the pose, codes are fitted anew to these points, and their sheets hang once more. The
    training codes with the least loss hang as well, and of the three outfits the one is taken whose
    silhouettes are most like the picture's. A sheet that has other pieces or openings than the
    training code's is another kind of garment, or none, and is never taken.

    Args:
        picture, models, settings, meshing, seed: as of `fit_picture`.
        people: what that has found.

    Returns:
        As `fit_picture`; what cannot be draped stays as it is.
    """
    draped = []
    for index, (person, outfit) in enumerate(zip(picture.people, people, strict=True)):
        body = posed_person(person, next(iter(models.values())).bodies)
        observed = {
            name: observe(picture, index, name, models[MODEL_OF_CLASS[name]], body)
            for name in outfit
        }
        draped.append(drape_person(person, outfit, observed, settings, meshing, seed, draper))
    return draped


def drape_person(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    observed: Mapping[str, Observation],
    settings: FitImage,
    meshing: Meshing,
    seed: int,
    draper: Draper,
) -> dict[str, FittedGarment]:
    """The garments of one person as they hang, with codes fitted to that; see `drape_picture`.

    Args:
        person: who wears them.
        outfit: class -> garment as fitted without hanging.
        observed: class -> what it was found in.
    """
    if not outfit:
        return {}
    nearest = decode_nearest(
        observed, BodyShape(person.gender, person.shape), settings, meshing, seed
    )
    ways = drape_candidates(person, outfit, nearest, observed, settings, meshing, seed, draper)
    return best_silhouette(ways, observed)


def drape_candidates(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    nearest: Mapping[str, FittedGarment],
    observed: Mapping[str, Observation],
    settings: FitImage,
    meshing: Meshing,
    seed: int,
    draper: Draper,
) -> dict[str, dict[str, FittedGarment]]:
    """Outfits of a person that hang, by how they were found.

    "fitted" is the outfit, "again" has codes that were fitted once more, to that as it hangs, and
    "nearest" is the one of training codes.

    Args:
        person, outfit, observed, settings, meshing, seed, draper: see `drape_person`.
        nearest: class -> garment of the training code with the least loss.

    Returns:
        Those that can be draped; if none can, the fitted one as it is.
    """
    bodies = next(iter(observed.values())).model.bodies
    outfit = keep_topology(outfit, nearest)
    ways = {"nearest": drape_outfit(nearest, person, bodies, draper)}
    draped = drape_sheets(outfit, person, bodies, draper)
    if draped:
        codes = _fit_to_cloth(person, outfit, draped, observed, settings, seed)
        wearer = BodyShape(person.gender, person.shape)
        again = decode_worn(_body(observed), wearer, codes, skinning_options(settings), meshing)
        ways["again"] = drape_outfit(keep_topology(again, nearest), person, bodies, draper)
        ways["fitted"] = use_draped(outfit, draped)
    return {name: way for name, way in ways.items() if way} or {"fitted": outfit}


def _fit_to_cloth(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    draped: Mapping[str, DrapedSheet],
    observed: Mapping[str, Observation],
    settings: FitImage,
    seed: int,
) -> dict[str, tuple[SmplicitModel, np.ndarray]]:
    """Class -> model and code, fitted to points that follow its sheet as it hangs."""
    wearer = BodyShape(person.gender, person.shape)
    # Codes are near where they go, so that half of the rounds are enough.
    fit = settings.replace(rounds=(settings.rounds + 1) // 2)
    codes = {name: (observed[name].model, garment.z) for name, garment in outfit.items()}
    for name, sheet in draped.items():
        around = add_cloth(_body(observed), sheet.rest.vertices, sheet.posed.vertices)
        model, known, view, label = observed[name]
        views = [view._replace(body=around)]
        (z,) = fit_codes_to_views(model, known, views, [wearer], [label], fit, seed)
        codes[name] = model, z
    return codes


def best_silhouette(
    ways: Mapping[str, dict[str, FittedGarment]], observed: Mapping[str, Observation]
) -> dict[str, FittedGarment]:
    """Of some outfits the one whose silhouettes are most like those in the picture."""
    return max(ways.values(), key=lambda outfit: _silhouette_iou(outfit, observed))


def _silhouette_iou(
    outfit: Mapping[str, FittedGarment], observed: Mapping[str, Observation]
) -> float:
    """Intersection over union of the garments' silhouettes with those in a picture, their mean."""
    camera = next(iter(observed.values())).view.camera
    parts = seen_parts(_body(observed), [garment.posed for garment in outfit.values()], camera)
    shares = []
    for number, name in enumerate(outfit, 2):
        view = observed[name].view
        shares.append(mask_iou(*(mask & ~view.unsure for mask in (parts == number, view.shown))))
    return float(np.mean(shares))


def _body(observed: Mapping[str, Observation]) -> PosedBody:
    return next(iter(observed.values())).view.body


def fit_image(
    model: SmplicitModel,
    shown: np.ndarray,
    camera: Camera,
    garment: str | None = None,
    *,
    gender: str,
    shape: Sequence[float],
    pose: Sequence[float],
    trans: Sequence[float],
    unsure: np.ndarray | None = None,
    seed: int = 0,
    draper: Draper | None = None,
) -> FittedGarment:
    """The garment that a picture shows on a known body; see `fit_picture` for whole pictures.

    Args:
        shown: (H, W) bool, the garment's pixels.
        garment: its type, any of the model's if None.
        pose: (72,) axis-angle, rad; its root rotation leads to the world of the camera.
        trans: (3,) the root joint there, metres.
        unsure: (H, W) bool, pixels that tell nothing about the garment, such as those of what
            hides it.
        draper: drapes its sheet on the body, see `drapeline.generation.moving_sheets.make_draper`;
            what is upright in the picture is taken for upright. Skinned if None.

    Raises:
        InputError: an argument has another size, the model is not for that type, no pixel shows
            the garment, or those that do are not near the body.
    """
    wearer = BodyShape(gender, finite("shape", shape, SHAPES))
    check_gender(gender)
    at = finite("pose", pose, 72), finite("trans", trans, 3)
    body = pose_body(model.bodies[gender], wearer.shape, *at)
    unsure = np.zeros_like(shown) if unsure is None else unsure
    if garment is not None and garment not in model.garments:
        raise InputError(f"garment: {garment!r:.60}, expected one of {', '.join(model.garments)}")
    codes = model.codes.z if garment is None else model.codes_of(garment)
    view, settings, meshing = GarmentView(shown, unsure, camera, body), FitImage(), Meshing()
    (z,) = fit_codes_to_views(model, codes, [view], [wearer], [model.name], settings, seed)
    name = class_of_garment(garment or model.garments[0])
    outfit = decode_worn(body, wearer, {name: (model, z)}, skinning_options(settings), meshing)
    if draper:
        person = Person(gender, wearer.shape, *at, camera, ~unsure, unsure, (name,))
        observed = {name: Observation(model, codes, view, model.name)}
        outfit = drape_person(person, outfit, observed, settings, meshing, seed, draper)
    return outfit[name]
