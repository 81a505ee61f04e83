"""Garments that were found in pictures, as a cloth solver lets them hang on their wearers. Ours."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from drapeline.bodies.follow import PosedBody, with_cloth
from drapeline.geometry.mesh import Mesh, loop_count
from drapeline.metrics.garment import mask_iou, piece_count
from drapeline.models.smplicit.fit_images import wearing
from drapeline.models.smplicit.fit_pictures import (
    FittedGarment,
    Sought,
    Wearer,
    dress,
    dress_nearest,
    fit_codes_to_views,
    posed_person,
    seek,
    seen_parts,
)
from drapeline.models.smplicit.pictures import GARMENT_CLASSES, Person, Picture
from drapeline.models.smplicit.settings import FitImage
from drapeline.outfits.worn import HungSheet

if TYPE_CHECKING:
    from drapeline.bodies.model import BodyModel
    from drapeline.models.smplicit.model import Meshing, SmplicitModel


class Hang(Protocol):
    """Hangs sheets on people, see `drapeline.generation.moving_sheets.Hang`."""

    def __call__(
        self,
        sheets: Mapping[str, Mesh],
        body: "BodyModel",
        gender: str,
        shape: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        up: np.ndarray,
    ) -> dict[str, HungSheet]:
        """Sheets by garment type as they hang; none if that failed."""
        ...


def hang_picture(
    picture: Picture,
    people: Sequence[Mapping[str, FittedGarment]],
    models: Mapping[str, "SmplicitModel"],
    settings: FitImage,
    meshing: "Meshing",
    seed: int,
    hang: Hang,
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
        hang: hangs sheets.

    Returns:
        As `fit_picture`; what cannot be hung stays as it is.
    """
    hung = []
    for index, (person, outfit) in enumerate(zip(picture.people, people, strict=True)):
        body = posed_person(person, models)
        sought = {
            name: seek(picture, index, name, models[GARMENT_CLASSES[name].model], body)
            for name in outfit
        }
        hung.append(hang_person(person, outfit, sought, settings, meshing, seed, hang))
    return hung


def hang_person(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    sought: Mapping[str, Sought],
    settings: FitImage,
    meshing: "Meshing",
    seed: int,
    hang: Hang,
) -> dict[str, FittedGarment]:
    """The garments of one person as they hang, with codes fitted to that; see `hang_picture`.

    Args:
        person: who wears them.
        outfit: class -> garment as fitted without hanging.
        sought: class -> what it was found in.
        settings, meshing, seed, hang: see there.
    """
    if not outfit:
        return {}
    nearest = dress_nearest(sought, Wearer(person.gender, person.shape), settings, meshing, seed)
    ways = hang_ways(person, outfit, nearest, sought, settings, meshing, seed, hang)
    return most_like(ways, sought)


def hang_ways(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    nearest: Mapping[str, FittedGarment],
    sought: Mapping[str, Sought],
    settings: FitImage,
    meshing: "Meshing",
    seed: int,
    hang: Hang,
) -> dict[str, dict[str, FittedGarment]]:
    """Outfits of a person that hang, by how they were found.

    "fitted" is the outfit, "again" has codes that were fitted once more, to that as it hangs, and
    "nearest" is the one of training codes.

    Args:
        person, outfit, sought, settings, meshing, seed, hang: see `hang_person`.
        nearest: class -> garment of the training code with the least loss.

    Returns:
        Those that can be hung; if none can, the fitted one as it is.
    """
    models = {GARMENT_CLASSES[name].model: one.model for name, one in sought.items()}
    outfit = same_kinds(outfit, nearest)
    ways = {"nearest": hang_outfit(nearest, person, models, hang)}
    hung = _hang_sheets(outfit, person, models, hang)
    if hung:
        codes = _fit_to_cloth(person, outfit, hung, sought, settings, seed)
        wearer = Wearer(person.gender, person.shape)
        again = dress(_body(sought), wearer, codes, wearing(settings), meshing)
        ways["again"] = hang_outfit(same_kinds(again, nearest), person, models, hang)
        ways["fitted"] = as_hung(outfit, hung)
    return {name: way for name, way in ways.items() if way} or {"fitted": outfit}


def _fit_to_cloth(
    person: Person,
    outfit: Mapping[str, FittedGarment],
    hung: Mapping[str, HungSheet],
    sought: Mapping[str, Sought],
    settings: FitImage,
    seed: int,
) -> dict[str, tuple["SmplicitModel", np.ndarray]]:
    """Class -> model and code, fitted to points that follow its sheet as it hangs."""
    wearer = Wearer(person.gender, person.shape)
    # Codes are near where they go, so that half of the rounds are enough.
    fit = settings.replace(rounds=(settings.rounds + 1) // 2)
    codes = {name: (sought[name].model, garment.z) for name, garment in outfit.items()}
    for name, sheet in hung.items():
        around = with_cloth(_body(sought), sheet.rest.vertices, sheet.posed.vertices)
        model, known, view, label = sought[name]
        views = [view._replace(body=around)]
        (z,) = fit_codes_to_views(model, known, views, [wearer], [label], fit, seed)
        codes[name] = model, z
    return codes


def most_like(
    ways: Mapping[str, dict[str, FittedGarment]], sought: Mapping[str, Sought]
) -> dict[str, FittedGarment]:
    """Of some outfits the one whose silhouettes are most like those in the picture."""
    return max(ways.values(), key=lambda outfit: _likeness(outfit, sought))


def _likeness(outfit: Mapping[str, FittedGarment], sought: Mapping[str, Sought]) -> float:
    """Intersection over union of the garments' silhouettes with those in a picture, their mean."""
    camera = next(iter(sought.values())).view.camera
    parts = seen_parts(_body(sought), [garment.posed for garment in outfit.values()], camera)
    shares = []
    for number, name in enumerate(outfit, 2):
        view = sought[name].view
        shares.append(mask_iou(*(mask & ~view.unsure for mask in (parts == number, view.shown))))
    return float(np.mean(shares))


def _body(sought: Mapping[str, Sought]) -> PosedBody:
    return next(iter(sought.values())).view.body


def hang_outfit(
    outfit: Mapping[str, FittedGarment],
    person: Person,
    models: Mapping[str, "SmplicitModel"],
    hang: Hang,
) -> dict[str, FittedGarment]:
    """The garments of a person as they hang; nothing if that fails."""
    hung = _hang_sheets(outfit, person, models, hang)
    return as_hung(outfit, hung) if hung else {}


def _hang_sheets(
    outfit: Mapping[str, FittedGarment],
    person: Person,
    models: Mapping[str, "SmplicitModel"],
    hang: Hang,
) -> dict[str, HungSheet]:
    """Class -> sheet as it hangs. What is upright in the picture is taken for upright."""
    hung = hang(
        {GARMENT_CLASSES[name].garment: garment.sheet for name, garment in outfit.items()},
        next(iter(models.values())).bodies[person.gender],
        person.gender,
        person.shape,
        person.pose,
        person.trans,
        -person.camera.axes[1],
    )
    return {
        name: hung[GARMENT_CLASSES[name].garment]
        for name in outfit
        if GARMENT_CLASSES[name].garment in hung
    }


def same_kinds(
    outfit: Mapping[str, FittedGarment], known: Mapping[str, FittedGarment]
) -> dict[str, FittedGarment]:
    """Garments, or known ones in place of those that have other pieces or openings than these."""
    return {
        name: garment if _kind(garment.sheet) == _kind(known[name].sheet) else known[name]
        for name, garment in outfit.items()
    }


def _kind(sheet: Mesh) -> tuple[int, int]:
    """Numbers of pieces and of openings."""
    return piece_count(sheet), loop_count(sheet.faces)


def as_hung(
    outfit: Mapping[str, FittedGarment], hung: Mapping[str, HungSheet]
) -> dict[str, FittedGarment]:
    """Garments as they hang; those that do not, as they are."""
    return {
        name: garment._replace(sheet=hung[name].rest, posed=hung[name].posed)
        if name in hung
        else garment
        for name, garment in outfit.items()
    }
