"""Evaluation of fits to pictures: renders of held-out simulated samples, with known truth.

A picture is the exact segmentation of a frame, seen from somewhere; body and camera are known. The
fitted garments stand beside those of the mean code of their class and of the training code of it
with the least loss. Those that hang on their wearers stand beside the mean code's, draped as well.
The same people are also found two by two, one behind the other.
"""

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody, pose_body
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, read_record, solver_name
from drapeline.dataset.shards import samples_named
from drapeline.errors import InputError
from drapeline.generation.moving_sheets import job_draper
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.metrics.garment import area_distances_mm, inside_measures, mask_iou
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import FittedPicture
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.smplicit.dressing import BodyShape, Draper, FittedGarment, decode_worn
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.drape import best_silhouette, drape_candidates, drape_outfit
from drapeline.models.smplicit.pictures.fit import skinning_options
from drapeline.models.smplicit.pictures.garments import (
    codes_of_class,
    decode_nearest,
    fit_picture,
    observe,
    seen_parts,
    shown_labels,
    shown_person,
)
from drapeline.models.smplicit.pictures.read import (
    BACKGROUND,
    BODY,
    CLASSES,
    GARMENT_CLASSES,
    Person,
    Picture,
    class_of_garment,
    garment_pixels,
)
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.rendering.camera import Camera, facing_direction, look_at, view_direction
from drapeline.rule_log import progress
from drapeline.schema import Table
from drapeline.seeding import rng_for

MODEL = "smplicit"
_DISTANCE_M, _MARGIN, _RISE = 4.0, 1.15, 0.25
_ASIDE = 0.2  # of a picture's width, how far a person stands beside the one in front
# Variant -> that of the mean code which is worn in the same way.
_MEANS = {
    **dict.fromkeys(("fitted", "fitted_in_pair", "nearest", "mean_code"), "mean_code"),
    **dict.fromkeys(("hung", "nearest_hung", "mean_code_hung"), "mean_code_hung"),
}
Measures = dict[str, float]
Outfit = dict[str, FittedGarment]


@dataclass(frozen=True)
class KnownPicture:
    """A picture of a simulated sample."""

    picture: Picture  # of one person
    clip: str  # that the sample moves through
    source: str  # cloth solver that moved the garments
    body: PosedBody  # at rest and posed
    true: dict[str, Mesh]  # class -> simulated garment, in the world of the camera
    garments: dict[str, str]  # class -> garment type

    @property
    def person(self) -> Person:
        """Who is in it."""
        return self.picture.people[0]

    @property
    def wearer(self) -> BodyShape:
        """Gender and shape."""
        return BodyShape(self.person.gender, self.person.shape)

    def segment(self, garments: Mapping[str, Mesh]) -> np.ndarray:
        """(H, W) indices into `CLASSES` of what its camera would see of other garments."""
        return _segment(self.body, garments, self.person.camera)


def take_pictures(
    samples: Sequence[str | Path],
    models: Mapping[str, SmplicitModel],
    *,
    count: int,
    size_px: int,
    seed: int,
) -> list[KnownPicture]:
    """Pictures, spread over samples, their frames, and the sides of the people.

    Args:
        samples: folders, simulated and accepted; without any there are no pictures.
        models: by their names of `FIELD_MODELS`; garments of others are only in the way.
        count: of pictures.
        size_px: their width and height.
        seed: draws the first side of each sample, and how high the cameras are.
    """
    if not samples:
        return []
    shares = Counter(index * len(samples) // count for index in range(count))
    pictures = []
    for number, share in shares.items():
        with Sample(samples[number]) as sample:
            pictures += [
                _take_picture(sample, models, (index, share), size_px, seed)
                for index in range(share)
            ]
    return pictures


def _take_picture(
    sample: Sample,
    models: Mapping[str, SmplicitModel],
    place: tuple[int, int],
    size_px: int,
    seed: int,
) -> KnownPicture:
    """One of so many of a sample, in a world whose origin is the root joint, like its caches."""
    index, count = place
    model = next(iter(models.values())).bodies[sample.gender]
    frame = (2 * index + 1) * sample.frame_count // (2 * count)
    shape, pose, trans = sample.info.shape, sample.info.poses[frame], np.zeros(3)
    body = pose_body(model, shape, pose, trans)
    rng = rng_for(seed, "pictures", sample.id)
    turn_deg = 360 * (rng.uniform() + index / count)
    rise = rng_for(seed, "picture", sample.id, index).uniform(0, _RISE)
    camera = _camera(body, pose, turn_deg, rise, size_px)
    types = {class_of_garment(garment): garment for garment in sample.garments}
    true = {
        name: Mesh(
            sample.vertices(garment, frame, frame + 1, "root")[0],
            triangulate(sample.mesh(garment).faces),
        )
        for name, garment in types.items()
    }
    classes = _segment(body, true, camera)
    nobody = np.zeros(classes.shape, dtype=bool)
    seen = tuple(
        name
        for name, pixels in garment_pixels(classes, ~nobody).items()
        if pixels and GARMENT_CLASSES[name].model in models
    )
    person = Person(sample.gender, shape, pose, trans, camera, ~nobody, nobody, seen)
    picture = Picture(f"{sample.id}_{frame:03d}", classes, None, (person,))
    meta = sample.meta or {}
    clip, source = clip_name(meta, sample.id), solver_name(meta)
    return KnownPicture(picture, clip, source, body, true, types)


def _camera(
    body: PosedBody, pose: np.ndarray, turn_deg: float, rise: float, size_px: int
) -> Camera:
    """A camera around the body, which fills the picture."""
    middle = (body.posed.min(axis=0) + body.posed.max(axis=0)) / 2
    way = view_direction(facing_direction(pose[:3]), turn_deg=turn_deg, rise=rise)
    reach = _MARGIN * float(np.ptp(body.posed, axis=0).max())
    return look_at(
        middle + _DISTANCE_M * way,
        middle,
        focal_px=size_px * _DISTANCE_M / reach,
        size=(size_px, size_px),
    )


def _segment(body: PosedBody, garments: Mapping[str, Mesh], camera: Camera) -> np.ndarray:
    classes = [CLASSES.index(name) for name in (BACKGROUND, BODY, *garments)]
    return np.array(classes, dtype=np.uint8)[seen_parts(body, [*garments.values()], camera)]


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
        nearest = decode_nearest(observed, known.wearer, *how)
        found = {"fitted": fitted, "nearest": nearest, "mean_code": mean_code}
        if self._draper:
            ways = drape_candidates(person, fitted, nearest, observed, *how, self._draper)
            found["hung"] = best_silhouette(ways, observed)
            seconds["hung"] = time.process_time() - start
            found["nearest_hung"] = ways.get("nearest", nearest)
            draped = drape_outfit(mean_code, person, self._models, self._draper)
            found["mean_code_hung"] = draped or mean_code
        return found, seconds

    def _model(self, name: str) -> SmplicitModel:
        return self._models[GARMENT_CLASSES[name].model]

    def _mean(self, known: KnownPicture) -> Outfit:
        codes = {
            name: (self._model(name), codes_of_class(self._model(name), name).mean(axis=0))
            for name in known.person.garments
        }
        return decode_worn(
            known.body, known.wearer, codes, skinning_options(self._fit), self._meshing
        )


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
    for all; distances to the simulated garment and back over the area, NaN where nothing is left of
    the garment; and how much is in the body.
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
            **inside_measures(garment.posed.vertices, known.body.posed, known.body.faces),
        }
    return measured


def _shown(known: KnownPicture, outfit: Outfit) -> FittedPicture:
    garments = {known.garments[name]: garment.posed for name, garment in outfit.items()}
    true = {known.garments[name]: mesh for name, mesh in known.true.items()}
    person = shown_person(known.person, known.body, garments, true)
    return FittedPicture(known.picture.name, shown_labels(known.picture.classes), None, (person,))


def evaluate_images(job: Job) -> None:
    """Garments found in pictures of held-out samples."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    spread, others = (
        [path for path in samples_named(given.samples, names) if read_record(path).accepted]
        for names in (params.samples, params.others)
    )
    if not spread and not others:
        raise InputError(
            f"all {len(params.samples) + len(params.others)} samples of the {params.split} split"
            " that pictures were wanted of were rejected, expected one that is accepted"
        )
    about = {"size_px": params.size_px, "seed": params.seed}
    pictures = take_pictures(spread, models, count=params.pictures, **about)
    pictures += take_pictures(others, models, count=len(others), **about)
    fit = FitImage(**params.fit)
    evaluation = PictureEvaluation(
        models,
        fit=fit,
        meshing=Meshing(**params.meshing),
        seed=params.seed,
        draper=job_draper(job, fit.hang_frames),
    )
    rows, shown = evaluation.run(pictures, params.split)

    def save_pictures(folder: Path) -> None:
        for picture in shown:
            picture.save(folder / f"{picture.name}.npz")

    write_evaluation(job.output[0], rows, save_pictures)
