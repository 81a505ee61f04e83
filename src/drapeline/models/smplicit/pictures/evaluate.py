"""Evaluation of fits to pictures: renders of held-out simulated samples, with known truth.

A picture is the exact segmentation of a frame, seen from somewhere; body and camera are known. The
fitted garments stand beside those of the mean code of their class and of the training code of it
with the least loss. Those that hang on their wearers stand beside the mean code's, draped as well.
The same people are also found two by two, one behind the other.
"""

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.generation.moving_sheets import job_draper
from drapeline.job import Job
from drapeline.metrics.garment import area_distances_mm, inside_measures, mask_iou
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import FittedPicture
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.pictures.dressed import (
    Draper,
    FittedGarment,
    drape_outfit,
    shown_labels,
    shown_person,
)
from drapeline.models.pictures.known import KnownPicture, pictures_of_job, rest_distances
from drapeline.models.pictures.read import CLASSES, Picture, garment_pixels
from drapeline.models.smplicit.dressing import BodyShape, decode_worn
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.drape import best_silhouette, drape_candidates
from drapeline.models.smplicit.pictures.fit import skinning_options
from drapeline.models.smplicit.pictures.garments import (
    MODEL_OF_CLASS,
    codes_of_class,
    decode_nearest,
    fit_picture,
    observe,
)
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.rule_log import progress
from drapeline.schema import Table

MODEL = "smplicit"
_ASIDE = 0.2  # of a picture's width, how far a person stands beside the one in front
# Variant -> that of the mean code which is worn in the same way.
_MEANS = {
    **dict.fromkeys(("fitted", "fitted_in_pair", "nearest", "mean_code"), "mean_code"),
    **dict.fromkeys(("hung", "nearest_hung", "mean_code_hung"), "mean_code_hung"),
}
Measures = dict[str, float]
Outfit = dict[str, FittedGarment]


def known_classes(models: Collection[str]) -> list[str]:
    """The classes of `GARMENT_CLASSES` whose garments some of `FIELD_MODELS` have learned."""
    return [name for name, model in MODEL_OF_CLASS.items() if model in models]


def join_people(front: Picture, behind: Picture, *, least_px: int) -> Picture:
    """A picture of two people, of whom the first hides a part of the second.

    The pictures are of one size; garments of which fewer than `least_px` show are not looked for.
    """
    height, width = front.classes.shape
    aside = round(_ASIDE * width)
    canvas = np.zeros((2, height, width + aside), dtype=np.uint8)
    canvas[0, :, :width], canvas[1, :, aside:] = front.classes, behind.classes
    first = canvas[0] > 0
    second = (canvas[1] > 0) & ~first
    classes = np.where(first, canvas[0], canvas[1])
    people = []
    for picture, others, left in ((front, second, 0), (behind, first, aside)):
        (person,) = picture.people
        intrinsics = person.camera.intrinsics + np.array([[0, 0, left], [0, 0, 0], [0, 0, 0]])
        camera = replace(person.camera, intrinsics=intrinsics, width=width + aside)
        count = garment_pixels(classes, ~others)
        garments = tuple(name for name in person.garments if count[name] >= max(least_px, 1))
        people.append(replace(person, camera=camera, own=~others, others=others, garments=garments))
    return Picture(f"{front.name}_{behind.name}", classes, None, tuple(people))


class PictureEvaluation:
    """Measures of garments found in pictures, and of what they are compared with.

    Without a draper only skinned sheets are measured.
    """

    def __init__(
        self,
        models: Mapping[str, SmplicitModel],
        *,
        fit: FitImage,
        meshing: Meshing,
        seed: int,
        draper: Draper | None = None,
    ) -> None:
        self._models, self._fit, self._meshing, self._seed = models, fit, meshing, seed
        self._draper = draper

    def run(
        self, pictures: Sequence[KnownPicture], split: str
    ) -> tuple[Table, list[FittedPicture]]:
        """All rows, and the pictures with what was found in them.

        Args:
            split: name of theirs.

        Raises:
            InputError: none of them shows a garment of a type that a model has learned.
        """
        pictures = [known for known in pictures if known.person.garments]
        if not pictures:
            raise InputError(
                f"no picture of the {split} split shows a garment of the models"
                f" {', '.join(self._models)}, expected some"
            )
        measured: dict[str, list[Measured]] = {}
        shown, means = [], {}
        for known in progress(pictures, total=len(pictures), label="pictures"):
            found, seconds = self._find(known)
            rows = {name: measure_outfit(known, outfit) for name, outfit in found.items()}
            means[known.picture.name] = rows["mean_code"]
            for name, part in rows.items():
                cost = {"fit_s": seconds[name]} if name in seconds else {}
                _record(measured, name, known, part, rows[_MEANS[name]], cost)
            shown.append(_shown(known, found["hung" if self._draper else "fitted"]))
        for known, outfit in self._find_in_pairs(pictures):
            part = measure_outfit(known, outfit)
            _record(measured, "fitted_in_pair", known, part, means[known.picture.name], {})
        summary = partial(summarise, model=MODEL, split=split, seed=self._seed)
        tables = (
            summary(part, variant=f"{MODEL}_images_{variant}") for variant, part in measured.items()
        )
        return join(tables), shown

    def _find_in_pairs(
        self, pictures: Sequence[KnownPicture]
    ) -> Iterator[tuple[KnownPicture, Outfit]]:
        """Pictures, and what is found in them when two are joined; an odd one stays out."""
        half = len(pictures) // 2
        pairs = list(zip(pictures[:half], pictures[half:], strict=False))
        for pair in progress(pairs, total=len(pairs), label="pairs"):
            joined = join_people(*(known.picture for known in pair), least_px=self._fit.least_px)
            outfits = fit_picture(joined, self._models, self._fit, self._meshing, self._seed)
            yield from zip(pair, outfits, strict=True)

    def _find(self, known: KnownPicture) -> tuple[dict[str, Outfit], dict[str, float]]:
        """Garments found in a picture, those beside them, and seconds that finding some took."""
        picture, person = known.picture, known.person
        how = self._fit, self._meshing, self._seed
        mean_code = self._mean(known)
        start = time.process_time()
        (fitted,) = fit_picture(picture, self._models, *how)
        seconds = {"fitted": time.process_time() - start}
        observed = {
            name: observe(picture, 0, name, self._model(name), known.body)
            for name in person.garments
        }
        nearest = decode_nearest(observed, _wearer(known), *how)
        found = {"fitted": fitted, "nearest": nearest, "mean_code": mean_code}
        if self._draper:
            ways = drape_candidates(person, fitted, nearest, observed, *how, self._draper)
            found["hung"] = best_silhouette(ways, observed)
            seconds["hung"] = time.process_time() - start
            found["nearest_hung"] = ways.get("nearest", nearest)
            draped = drape_outfit(mean_code, person, self._bodies, self._draper)
            found["mean_code_hung"] = draped or mean_code
        return found, seconds

    def _model(self, name: str) -> SmplicitModel:
        return self._models[MODEL_OF_CLASS[name]]

    @property
    def _bodies(self) -> Mapping[str, BodyModel]:
        return next(iter(self._models.values())).bodies

    def _mean(self, known: KnownPicture) -> Outfit:
        codes = {
            name: (self._model(name), codes_of_class(self._model(name), name).mean(axis=0))
            for name in known.person.garments
        }
        return decode_worn(
            known.body, _wearer(known), codes, skinning_options(self._fit), self._meshing
        )


def _wearer(known: KnownPicture) -> BodyShape:
    return BodyShape(known.person.gender, known.person.shape)


def _record(
    measured: dict[str, list[Measured]],
    variant: str,
    known: KnownPicture,
    part: Mapping[str, Measures],
    mean: Mapping[str, Measures],
    cost: Measures,
) -> None:
    """Add what was measured of a variant in a picture, beside its mean code."""
    for name, values in part.items():
        better = {}
        if variant not in _MEANS.values():
            share = float(values["silhouette_iou"] > mean[name]["silhouette_iou"])
            better = {"better_than_mean_share": share}
        one = Measured(known.clip, known.garments[name], {**values, **better, **cost}, known.source)
        measured.setdefault(variant, []).append(one)


def silhouette_iou(found: np.ndarray, true: np.ndarray, name: str) -> float:
    """Pixels (H, W) of a class in both segmentations, as a share of those in either."""
    return mask_iou(found == CLASSES.index(name), true == CLASSES.index(name))


def measure_outfit(known: KnownPicture, outfit: Outfit) -> dict[str, Measures]:
    """Measures of each garment of a picture, by class.

    The silhouette's IoU, with all garments in place, simulated ones where none was looked for; the
    share of pixels with the right label among those of the person in either segmentation, the same
    for all; distances to the simulated garment and back over the area, and likewise at rest, NaN
    where nothing is left of the garment; and how much is in the body.
    """
    worn = {name: garment.posed for name, garment in outfit.items()}
    found = known.segment(known.true | worn)
    true = known.picture.classes
    person = (found > 0) | (true > 0)
    measured = {}
    for name, garment in outfit.items():
        to_true, to_surface = area_distances_mm(garment.posed, known.true[name])
        measured[name] = {
            "silhouette_iou": silhouette_iou(found, true, name),
            "segmentation_accuracy": float((found == true)[person].mean()),
            "surface_to_true_mm": to_true,
            "true_to_surface_mm": to_surface,
            **rest_distances(garment.sheet, known.rest[name]),
            **inside_measures(garment.posed.vertices, known.body.posed, known.body.faces),
        }
    return measured


def _shown(known: KnownPicture, outfit: Outfit) -> FittedPicture:
    garments = {known.garments[name]: garment.posed for name, garment in outfit.items()}
    true = {known.garments[name]: mesh for name, mesh in known.true.items()}
    rest = {known.garments[name]: garment.sheet for name, garment in outfit.items()}
    person = shown_person(known.person, known.body, garments, true, rest)
    return FittedPicture(known.picture.name, shown_labels(known.picture.classes), None, (person,))


def evaluate_images(job: Job) -> None:
    """Garments found in pictures of held-out samples."""
    params = job.params
    torch.set_num_threads(job.threads)
    models = {model.name: model for model in map(SmplicitModel, job.input.models)}
    fit = FitImage(**params.fit)
    evaluation = PictureEvaluation(
        models,
        fit=fit,
        meshing=Meshing(**params.meshing),
        seed=params.seed,
        draper=job_draper(job, fit.hang_frames),
    )
    bodies = next(iter(models.values())).bodies
    pictures = pictures_of_job(job, bodies, known_classes(models))
    rows, shown = evaluation.run(pictures, params.split)

    def save_pictures(folder: Path) -> None:
        for picture in shown:
            picture.save(folder / f"{picture.name}.npz")

    write_evaluation(job.output[0], rows, save_pictures)
