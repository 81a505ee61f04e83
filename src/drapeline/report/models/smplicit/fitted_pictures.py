"""Garments that were found in pictures: laid over the picture, from the side, beside the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.fitted_pictures import (
    BODY,
    FIRST_GARMENT,
    UNKNOWN,
    FittedPicture,
    PersonShown,
)
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.camera import Camera
from drapeline.rendering.modalities import cast_rays
from drapeline.rendering.picture_grid import GridCell, save_grid
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.colours import garment_colour
from drapeline.rule_log import progress

OWN_COLUMNS = ("picture", "found", "from the side")
KNOWN_COLUMNS = (
    "segmentation",
    "found",
    "simulated",
    "found,\nfrom the side",
    "simulated,\nfrom the side",
)
_OWN_PX, _KNOWN_PX = 480, 260
_WIDEST = 1.6  # times as wide as high
_FADE = 0.65  # of a picture towards white, below what was found in it
_UNKNOWN_COLOUR = (0.9, 0.9, 0.6)
_TURN = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])  # a quarter turn about the vertical
_DISTANCE_M, _MARGIN = 7.0, 1.1
_FLOATING_M = 50.0  # high above the floor, whose shadows would fall on the picture


def plot_own_picture(path: str | Path, picture: FittedPicture) -> None:
    """Write a user's picture with what was found in it."""
    before, found = _seen(picture, "garments")
    aspect = min(max(before.shape[1] / before.shape[0], 1), _WIDEST)
    size = (round(aspect * _OWN_PX), _OWN_PX)
    cells = (before, found, _side(picture, "garments", _OWN_PX))
    save_grid(path, [[GridCell(_fit(cell, size)) for cell in cells]], columns=OWN_COLUMNS)


def plot_known_pictures(path: str | Path, pictures: Sequence[FittedPicture]) -> None:
    """Write a row for each picture of simulated garments."""
    rows = []
    for picture in progress(pictures, total=len(pictures), label="pictures"):
        before, found = _seen(picture, "garments")
        _, true = _seen(picture, "true")
        sides = [_side(picture, kind, _KNOWN_PX) for kind in ("garments", "true")]
        cells = (before, found, true, *sides)
        rows.append([GridCell(_fit(cell, (_KNOWN_PX, _KNOWN_PX))) for cell in cells])
    save_grid(
        path,
        rows,
        columns=KNOWN_COLUMNS,
        labels=[picture.name.replace("_", "\nframe ") for picture in pictures],
    )


def label_colours(labels: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 segmentation (H, W) in the colours of garments."""
    colours = np.ones((FIRST_GARMENT + len(GARMENTS), 3))
    colours[BODY], colours[UNKNOWN] = BODY_COLOUR, _UNKNOWN_COLOUR
    colours[FIRST_GARMENT:] = [garment_colour(garment) for garment in GARMENTS]
    return np.round(255 * colours).astype(np.uint8)[labels]


def _seen(picture: FittedPicture, kind: str) -> list[np.ndarray]:
    """The picture, and with garments over it, cut to where people are."""
    before = label_colours(picture.labels) if picture.photo is None else picture.photo
    after = np.round(before + _FADE * (255.0 - before)).astype(np.uint8)
    # The nearest last: what is near is large.
    for person in sorted(picture.people, key=_scale):
        after = _draw(after, person, getattr(person, kind))
    return [_cut(image, picture) for image in (before, after)]


def _scale(person: PersonShown) -> float:
    """Pixels per metre at the body."""
    _, depth = _camera(person, (1, 1)).project(person.body.vertices.mean(axis=0))
    return float(person.intrinsics[0, 0] / depth)


def _camera(person: PersonShown, size: tuple[int, int]) -> Camera:
    return Camera(person.intrinsics, person.world_to_camera, *size)


def _draw(image: np.ndarray, person: PersonShown, garments: Mapping[str, Mesh]) -> np.ndarray:
    """A dressed person over an image (H, W, 3) uint8."""
    camera = _camera(person, image.shape[1::-1])
    parts = [
        replace(part, vertices=_upright(part.vertices, camera)) for part in _parts(person, garments)
    ]
    level = Camera(camera.intrinsics, _LEVEL, camera.width, camera.height)
    rendered = raytrace(parts, level, samples=12)
    hit = cast_rays([(p.vertices, p.faces, np.zeros_like(p.vertices)) for p in parts], level)
    return np.where(hit.segments[..., None] > 0, rendered, image)


# The camera of a world that is upright in the picture, whatever the axes of the person's.
_LEVEL = np.array([[1, 0, 0, 0], [0, 0, -1, _FLOATING_M], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def _upright(points: np.ndarray, camera: Camera) -> np.ndarray:
    """(P, 3) points as the camera sees them: x to the right, y away, z up."""
    seen = points @ camera.axes.T + camera.world_to_camera[:3, 3]
    return np.stack([seen[:, 0], seen[:, 2], _FLOATING_M - seen[:, 1]], axis=1)


def _parts(person: PersonShown, garments: Mapping[str, Mesh]) -> list[ColouredMesh]:
    parts = [ColouredMesh(person.body.vertices, person.body.faces, BODY_COLOUR)]
    return parts + [
        ColouredMesh(mesh.vertices, mesh.faces, garment_colour(name))
        for name, mesh in garments.items()
        if len(mesh.faces)
    ]


def _side(picture: FittedPicture, kind: str, size_px: int) -> np.ndarray:
    """All people from the right of the picture, one beside the other."""
    views = [_side_of_person(one, getattr(one, kind), size_px) for one in picture.people]
    return np.concatenate([_narrow(view) for view in views], axis=1)


def _narrow(view: np.ndarray) -> np.ndarray:
    """A view without the empty columns at its sides, but for a margin."""
    (drawn,) = np.nonzero((view != view[0, 0]).any(axis=(0, 2)))
    margin = view.shape[1] // 20
    return view[:, max(0, drawn[0] - margin) : drawn[-1] + 1 + margin]


def _side_of_person(person: PersonShown, garments: Mapping[str, Mesh], size_px: int) -> np.ndarray:
    camera = _camera(person, (size_px, size_px))
    parts = [
        replace(part, vertices=_upright(part.vertices, camera) @ _TURN.T)
        for part in _parts(person, garments)
    ]
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    shift = np.array([0, 0, _FLOATING_M]) - (low + high) / 2
    parts = [replace(part, vertices=part.vertices + shift) for part in parts]
    focal = size_px * _DISTANCE_M / (_MARGIN * float((high - low)[[0, 2]].max()))
    intrinsics = np.array([[focal, 0, size_px / 2], [0, focal, size_px / 2], [0, 0, 1.0]])
    view = _LEVEL.copy()
    view[2, 3] = _DISTANCE_M
    return raytrace(parts, Camera(intrinsics, view, size_px, size_px), samples=12)


def _cut(image: np.ndarray, picture: FittedPicture) -> np.ndarray:
    """The part of a picture that shows people, with a margin."""
    rows, columns = np.nonzero(picture.labels)
    part = []
    for places, length in ((rows, image.shape[0]), (columns, image.shape[1])):
        first, last = (int(places.min()), int(places.max())) if len(places) else (0, length)
        margin = round(0.1 * (last - first)) + 2
        part.append(slice(max(0, first - margin), min(length, last + margin)))
    return image[tuple(part)]


def _fit(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """An image scaled to fit a size (width, height), in the middle of white."""
    scale = min(size[0] / image.shape[1], size[1] / image.shape[0])
    inner = (max(1, round(scale * image.shape[1])), max(1, round(scale * image.shape[0])))
    sheet = Image.new("RGB", size, (255, 255, 255))
    place = ((size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2)
    sheet.paste(Image.fromarray(image).resize(inner, Image.Resampling.LANCZOS), place)
    return np.asarray(sheet)
