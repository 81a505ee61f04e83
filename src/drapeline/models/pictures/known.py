"""Pictures of simulated samples: exact segmentations of their frames, with all that is known."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.bodies.follow import PosedBody, pose_body
from drapeline.bodies.model import BodyModel
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, read_record, solver_name
from drapeline.dataset.shards import samples_named
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.metrics.garment import area_distances_mm
from drapeline.models.pictures.dressed import seen_parts
from drapeline.models.pictures.read import (
    BACKGROUND,
    BODY,
    CLASSES,
    Person,
    Picture,
    class_of_garment,
    garment_pixels,
)
from drapeline.rendering.camera import Camera, facing_direction, look_at, view_direction
from drapeline.seeding import rng_for

_DISTANCE_M, _MARGIN = 4.0, 1.15
RISE = 0.25  # most that cameras are higher than what they look at, per unit of distance


@dataclass(frozen=True)
class KnownPicture:
    """A picture of a simulated sample."""

    picture: Picture  # of one person
    sample: str  # its id
    clip: str  # that the sample moves through
    source: str  # cloth solver that moved the garments
    body: PosedBody  # at rest and posed
    rest: dict[str, Mesh]  # class -> garment at rest, root-relative metres
    true: dict[str, Mesh]  # class -> simulated garment, in the world of the camera
    garments: dict[str, str]  # class -> garment type

    @property
    def person(self) -> Person:
        """Who is in it."""
        return self.picture.people[0]

    def segment(self, garments: Mapping[str, Mesh]) -> np.ndarray:
        """(H, W) indices into `CLASSES` of what its camera would see of other garments."""
        return segment(self.body, garments, self.person.camera)


def pictures_of_job(
    job: Job, bodies: Mapping[str, BodyModel], known: Collection[str]
) -> list[KnownPicture]:
    """The pictures that models are evaluated on, the same for all of them.

    Args:
        job: with `samples`, and told what `plan.pictured_samples` says.
        bodies: by gender.
        known: classes to look for; garments of others are only in the way.

    Raises:
        InputError: no sample was accepted.
    """
    params = job.params
    spread, others = (
        [path for path in samples_named(job.input.samples, names) if read_record(path).accepted]
        for names in (params.samples, params.others)
    )
    if not spread and not others:
        raise InputError(
            f"all {len(params.samples) + len(params.others)} samples of the {params.split} split"
            " that pictures were wanted of were rejected, expected one that is accepted"
        )
    how = {"size_px": params.size_px, "seed": params.picture_seed}
    pictures = take_pictures(spread, bodies, known, count=params.pictures, **how)
    return pictures + take_pictures(others, bodies, known, count=len(others), **how)


def take_pictures(
    samples: Sequence[str | Path],
    bodies: Mapping[str, BodyModel],
    known: Collection[str],
    *,
    count: int,
    size_px: int,
    seed: int,
) -> list[KnownPicture]:
    """Pictures, spread over samples, their frames, and the sides of the people.

    Args:
        samples: folders, simulated and accepted; without any there are no pictures.
        bodies: by gender.
        known: classes to look for; garments of others are only in the way.
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
                _take_picture(sample, bodies, known, (index, share), size_px, seed)
                for index in range(share)
            ]
    return pictures


def _take_picture(
    sample: Sample,
    bodies: Mapping[str, BodyModel],
    known: Collection[str],
    place: tuple[int, int],
    size_px: int,
    seed: int,
) -> KnownPicture:
    """One of so many of a sample, in a world whose origin is the root joint, like its caches."""
    index, count = place
    frame = (2 * index + 1) * sample.frame_count // (2 * count)
    shape, pose, trans = sample.info.shape, sample.info.poses[frame], np.zeros(3)
    body = pose_body(bodies[sample.gender], shape, pose, trans)
    rng = rng_for(seed, "pictures", sample.id)
    turn_deg = 360 * (rng.uniform() + index / count)
    rise = rng_for(seed, "picture", sample.id, index).uniform(0, RISE)
    camera = camera_around(body.posed, pose, turn_deg, rise, size_px)
    types = {class_of_garment(garment): garment for garment in sample.garments}
    rest, true = {}, {}
    for name, garment in types.items():
        mesh = sample.mesh(garment)
        rest[name] = Mesh(mesh.vertices, triangulate(mesh.faces))
        (cloth,) = sample.vertices(garment, frame, frame + 1, "root")
        true[name] = Mesh(cloth, rest[name].faces)
    classes = segment(body, true, camera)
    nobody = np.zeros(classes.shape, dtype=bool)
    seen = tuple(
        name
        for name, pixels in garment_pixels(classes, ~nobody).items()
        if pixels and name in known
    )
    person = Person(sample.gender, shape, pose, trans, camera, ~nobody, nobody, seen)
    picture = Picture(f"{sample.id}_{frame:03d}", classes, None, (person,))
    meta = sample.meta or {}
    clip, source = clip_name(meta, sample.id), solver_name(meta)
    return KnownPicture(picture, sample.id, clip, source, body, rest, true, types)


def rest_distances(found: Mesh, true: Mesh) -> dict[str, float]:
    """Distances over the area between garments at rest, in the table of metrics' names.

    NaN where nothing was found.
    """
    to_true, to_found = area_distances_mm(found, true)
    return {"rest_to_true_mm": to_true, "true_to_rest_mm": to_found}


def camera_around(
    body: np.ndarray, pose: np.ndarray, turn_deg: float, rise: float, size_px: int
) -> Camera:
    """A camera of square pictures that a body (V, 3) in a pose (72,) fills.

    Args:
        turn_deg, rise: where it stands, see `view_direction`.
        size_px: of its pictures.
    """
    low, high = body.min(axis=0), body.max(axis=0)
    middle = (low + high) / 2
    way = view_direction(facing_direction(pose[:3]), turn_deg=turn_deg, rise=rise)
    reach = _MARGIN * float((high - low).max())
    return look_at(
        middle + _DISTANCE_M * way,
        middle,
        focal_px=size_px * _DISTANCE_M / reach,
        size=(size_px, size_px),
    )


def segment(body: PosedBody, garments: Mapping[str, Mesh], camera: Camera) -> np.ndarray:
    """(H, W) uint8 indices into `CLASSES` of what a camera sees of garments by class on a body."""
    classes = [CLASSES.index(name) for name in (BACKGROUND, BODY, *garments)]
    return np.array(classes, dtype=np.uint8)[seen_parts(body, [*garments.values()], camera)]
