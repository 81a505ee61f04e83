"""Pictures of dressed people as a user gives them: one JSON per picture, and images beside it.

    {
      "segmentation": "street_labels.png",
      "labels": "lip",
      "photo": "street.jpg",
      "instances": "street_people.png",
      "camera": {"focal_px": 1150.0, "centre_px": [640.0, 360.0]},
      "people": [
        {
          "gender": "female",
          "shape": [0.3, ...],
          "pose": [3.0, ...],
          "transl": [0.1, 0.2, 4.5],
          "instance": 1
        }
      ]
    }

docs/how-to/own-pictures.md explains every entry. Everything is checked on reading.
"""

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.bodies.rest_body import SHAPES
from drapeline.errors import InputError, refuse_damage
from drapeline.frames import GENDERS
from drapeline.outfits.garment_types import GARMENT_TYPES
from drapeline.rendering.camera import Camera
from drapeline.storage import open_arrays, read_json

_FAR_M = 400.0  # from where a pinhole's picture is that of a weak perspective, to a pixel
_CROP_PX = 224  # of the crops that most body estimators look at


# Classes of garments that segmentations tell apart, and the type that stands for each in colours
# and file names. From the innermost to the outermost: what is worn over a garment hides it.
GARMENT_CLASSES = {
    "trousers": "Trousers",
    "skirt": "Skirt",
    "jumpsuit": "Jumpsuit",
    "dress": "Dress",
    "upper": "Tshirt",
    "coat": "Jacket",
}
BACKGROUND, BODY, UNKNOWN = "background", "body", "unknown"
CLASSES = (BACKGROUND, BODY, UNKNOWN, *GARMENT_CLASSES)


def class_of_garment(garment: str) -> str:
    """The class of `GARMENT_CLASSES` that a segmentation calls a garment type."""
    kind = GARMENT_TYPES[garment]
    if kind.outer:
        return "coat"
    return next(
        name
        for name, stands in GARMENT_CLASSES.items()
        if stands == garment or (kind.region == "upper" and name == "upper")
    )


def garment_pixels(classes: np.ndarray, own: np.ndarray) -> dict[str, int]:
    """Counts by garment class of a person's `own` pixels (H, W) of `classes` (H, W)."""
    count = np.bincount(classes[own], minlength=len(CLASSES))
    return {name: int(count[CLASSES.index(name)]) for name in GARMENT_CLASSES}


def _table(*names: str) -> dict[int, str]:
    return dict(enumerate(names))


_LIP = (
    *(BACKGROUND, UNKNOWN, UNKNOWN, BODY, BODY),  # hat, hair, glove, sunglasses
    *("upper", "dress", "coat", BODY, "trousers", "jumpsuit"),  # 8 socks
    *(UNKNOWN, "skirt", BODY, BODY, BODY, BODY, BODY, BODY, BODY),  # 11 scarf
)
# What the labels of public segmentation networks mean. Hair, hats, scarves, belts and bags hide
# what is below them.
LABELS = {
    # Look into Person: SCHP and others trained on it.
    "lip": _table(*_LIP),
    # Crowd Instance-level Human Parsing: Graphonomy; as LIP, but label 10 is the torso's skin.
    "cihp": {**_table(*_LIP), 10: BODY},
    "atr": _table(
        *(BACKGROUND, UNKNOWN, UNKNOWN, BODY),  # hat, hair, sunglasses
        *("upper", "skirt", "trousers", "dress", UNKNOWN),  # 8 belt
        *(BODY, BODY, BODY, BODY, BODY, BODY, BODY),
        *(UNKNOWN, UNKNOWN),  # bag, scarf
    ),
}


@dataclass(frozen=True)
class Person:
    """A person in a picture."""

    gender: str  # "female" or "male"
    shape: np.ndarray  # (10,)
    pose: np.ndarray  # (72,) axis-angle, rad; its root rotation leads to the world of the camera
    trans: np.ndarray  # (3,) the root joint there, metres
    camera: Camera
    own: np.ndarray  # (H, W) bool, pixels that belong to the person, or to nobody
    others: np.ndarray  # (H, W) bool, pixels of other people
    # Classes to fit, of `GARMENT_CLASSES`, from the innermost to the outermost.
    garments: tuple[str, ...]


@dataclass(frozen=True)
class Picture:
    """A picture of dressed people."""

    name: str  # of its file
    classes: np.ndarray  # (H, W) uint8 indices into `CLASSES`
    photo: np.ndarray | None  # (H, W, 3) uint8, or None
    people: tuple[Person, ...]  # in it

    def shows(self, person: Person, garment: str) -> np.ndarray:
        """(H, W) bool, where a person's garment is seen."""
        return (self.classes == CLASSES.index(garment)) & person.own

    def unsure(self, person: Person, garment: str) -> np.ndarray:
        """(H, W) bool, pixels that say nothing about a person's garment.

        Other people's, those of things that are no garments but hide them, and those of what is
        worn over the garment.
        """
        over = self.classes > CLASSES.index(garment)
        return (self.classes == CLASSES.index(UNKNOWN)) | over | person.others


def weak_perspective(
    weak: Sequence[float] | np.ndarray,
    corner_px: Sequence[float] | np.ndarray,
    ratio: float,
    size: tuple[int, int],
) -> Camera:
    """The camera of a weak perspective in a square crop, as FrankMocap gives it.

    A point (x, y, z) of the camera's axes, metres, is at 112 (s x + tx + 1) / ratio + left and
    112 (s y + ty + 1) / ratio + top of the picture. This is a pinhole's picture from far away.

    Args:
        weak: (s, tx, ty).
        corner_px: (left, top) of the crop in the picture (`bbox_top_left`).
        ratio: pixels of the crop, which are 224, per pixel of the picture (`bbox_scale_ratio`).
    """
    scale, *shift = weak
    half = _CROP_PX / 2 / ratio
    middle = half * (np.array(shift) + 1) + corner_px
    focal = half * scale * _FAR_M
    intrinsics = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]])
    world_to_camera = np.eye(4)
    world_to_camera[2, 3] = _FAR_M
    return Camera(intrinsics, world_to_camera, *size)


def read_picture(path: str | Path, bodies: Mapping[str, BodyModel], *, least_px: int) -> Picture:
    """Read a picture.

    Args:
        path: the JSON; names of images in it are relative to its folder.
        bodies: by gender.
        least_px: a garment with fewer pixels is left out, unless it is asked for by name.

    Raises:
        InputError: something is missing or does not fit together; names the file and the entry.
    """
    path = Path(path)
    given = _object(path, read_json(path), "the picture")
    labels = _labels(path, given)
    values = _image(path, given, "segmentation")
    if values.ndim != 2 or values.dtype.kind not in "iub" or not values.size:
        raise InputError(
            f"{path}: the segmentation, {given['segmentation']}, has shape {values.shape} and type"
            f" {values.dtype}, expected one label per pixel (a grey or palette image)"
        )
    classes = _classes(f"{path}: the segmentation, {given['segmentation']},", values, labels)
    photo = _photo(path, given, classes.shape) if given.get("photo") is not None else None
    people = given.get("people")
    if not isinstance(people, list) or not people:
        raise InputError(f"{path}: 'people' is empty or missing, expected one entry per person")
    people = [_object(path, one, f"person {number}") for number, one in enumerate(people, 1)]
    masks = _masks(path, given, people, classes.shape)
    return Picture(
        path.stem,
        classes,
        photo,
        tuple(
            _PersonReader(path, f"person {index + 1}", one, given, bodies).person(
                classes, masks, index, least_px
            )
            for index, one in enumerate(people)
        ),
    )


def _object(path: Path, value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{path}: {name} is a {type(value).__name__}, expected entries by name")
    return value


_LOSSY = ("JPEG", "JPEG2000", "MPO")
_OPAQUE = 127  # of 255
_LABEL = re.compile(r"[0-9]{1,9}")


def _labels(path: Path, given: Mapping[str, Any]) -> dict[int, str]:
    labels = given.get("labels")
    if isinstance(labels, str) and labels in LABELS:
        return LABELS[labels]
    if not isinstance(labels, dict) or not labels:
        raise InputError(
            f"{path}: 'labels' is {labels!r}, expected {', '.join(LABELS)} or a table of labels and"
            " classes"
        )
    wrong = [k for k, v in labels.items() if not _LABEL.fullmatch(k) or v not in CLASSES]
    if wrong:
        raise InputError(
            f"{path}: 'labels' has '{wrong[0]}': {labels[wrong[0]]!r}, expected a number and one of"
            f" {', '.join(CLASSES)}"
        )
    return {int(label): name for label, name in labels.items()}


def _image(path: Path, given: Mapping[str, Any], key: str, where: str = "") -> np.ndarray:
    """(H, W) labels of a grey or palette image or an `.npy`, or (H, W, 3) colours.

    Of a mask that is cut out (H, W) bool, where it is opaque.
    """
    name = given.get(key)
    if not isinstance(name, str):
        raise InputError(f"{path}: {where}'{key}' is {name!r}, expected the name of an image")
    file = path.parent / name
    if file.suffix == ".npy":
        return np.array(open_arrays(file.parent, {file.stem: "number ..."})[file.stem])
    with refuse_damage(file, f"an image, the {key} of {path}"), warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        # From memory, where a chunk that is said to be longer than the file takes no room.
        with Image.open(BytesIO(file.read_bytes())) as image:
            if key != "photo" and image.format in _LOSSY:
                raise InputError(
                    f"{path}: {where}'{key}' is {name}, a {image.format}, which changes labels;"
                    " expected a PNG or an .npy"
                )
            if key == "mask" and image.has_transparency_data:
                opaque = np.asarray(image.convert("RGBA"))[..., 3] > _OPAQUE
                if not opaque.all():
                    return opaque
            return np.asarray(
                image if image.mode in ("L", "P", "I;16", "I") else image.convert("RGB")
            )


def _photo(path: Path, given: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    photo = _image(path, given, "photo")
    _check_size(path, f"photo, {given['photo']},", photo, shape)
    return np.repeat(photo[..., None], 3, axis=2) if photo.ndim == 2 else photo


def _check_size(path: Path, name: str, image: np.ndarray, shape: tuple[int, ...]) -> None:
    if image.shape[:2] != shape:
        raise InputError(
            f"{path}: the {name} has {image.shape[1]} x {image.shape[0]} pixels, expected"
            f" {shape[1]} x {shape[0]} like the segmentation"
        )


def _classes(what: str, values: np.ndarray, labels: Mapping[int, str]) -> np.ndarray:
    found = np.unique(values)
    strange = [int(label) for label in found if int(label) not in labels]
    if strange:
        raise InputError(
            f"{what} has the labels {', '.join(map(str, strange[:5]))}, expected only those of"
            f" 'labels' ({min(labels)} to {max(labels)})"
        )
    of_label = np.array([CLASSES.index(labels[int(label)]) for label in found], dtype=np.uint8)
    return of_label[np.searchsorted(found, values)]


def _masks(
    path: Path, given: Mapping[str, Any], people: Sequence[Mapping], shape: tuple[int, ...]
) -> np.ndarray | None:
    """(N, H, W) bool, the pixels of each person; None if all pixels are of the only one."""
    if given.get("instances") is not None:
        image = _image(path, given, "instances")
        _check_size(path, f"image of instances, {given['instances']},", image, shape)
        if image.ndim != 2:
            raise InputError(
                f"{path}: the image of instances, {given['instances']}, has colours, expected one"
                " number per pixel (a grey or palette image)"
            )
        numbers = [one.get("instance") for one in people]
        for index, number in enumerate(numbers, 1):
            if not isinstance(number, int) or number < 1 or not (image == number).any():
                raise InputError(
                    f"{path}: person {index} has 'instance': {number!r}, expected the number of"
                    " some pixels of 'instances'"
                )
        return np.stack([image == number for number in numbers])
    if all(one.get("mask") is not None for one in people):
        masks = [_image(path, one, "mask", f"person {i}: ") for i, one in enumerate(people, 1)]
        for index, mask in enumerate(masks, 1):
            _check_size(path, f"mask of person {index}, {people[index - 1]['mask']},", mask, shape)
        return np.stack([mask.reshape(*shape, -1).any(axis=2) for mask in masks])
    if len(people) == 1:
        return None
    raise InputError(
        f"{path}: {len(people)} people, expected 'instances' or a 'mask' for each, to tell their"
        " pixels apart"
    )


@dataclass(frozen=True)
class _PersonReader:
    """Reads one person of a picture."""

    path: Path
    where: str
    entry: Mapping[str, Any]
    picture: Mapping[str, Any]
    bodies: Mapping[str, BodyModel]

    def person(
        self, classes: np.ndarray, masks: np.ndarray | None, index: int, least_px: int
    ) -> Person:
        own = np.ones(classes.shape, dtype=bool)
        others = ~own
        if masks is not None:
            others = np.delete(masks, index, axis=0).any(axis=0) & ~masks[index]
            # A garment that nobody wears may be anybody's.
            others |= ~masks[index] & (classes > CLASSES.index(UNKNOWN))
            own = ~others
        gender, shape = self._gender(), self._numbers(self.entry, "shape", (SHAPES,))
        pose = self._pose()
        camera = self._camera(classes.shape)
        trans = self._trans(gender, shape)
        garments = self._garments(classes, own, least_px)
        person = Person(gender, shape, pose, trans, camera, own, others, garments)
        self._check_seen(person)
        return person

    def _fail(self, text: str) -> InputError:
        return InputError(f"{self.path}: {self.where}: {text}")

    def _gender(self) -> str:
        gender = self.entry.get("gender")
        if gender not in GENDERS or gender not in self.bodies:
            raise self._fail(f"'gender' is {gender!r}, expected {' or '.join(self.bodies)}")
        return gender

    def _numbers(self, entry: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
        try:
            array = np.asarray(entry.get(key), dtype=np.float64)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.shape != shape or not np.isfinite(array).all():
            size = " x ".join(map(str, shape)) or "one"
            raise self._fail(f"'{key}' is missing or wrong, expected {size} finite numbers")
        return array

    def _pose(self) -> np.ndarray:
        """(72,) of 72 numbers, or of 24 rotation matrices."""
        pose = self.entry.get("pose")
        if isinstance(pose, list) and len(pose) == 24:
            turns = self._numbers(self.entry, "pose", (24, 3, 3))
            return Rotation.from_matrix(turns).as_rotvec().ravel()
        return self._numbers(self.entry, "pose", (72,))

    def _camera(self, shape: tuple[int, ...]) -> Camera:
        given = self.entry.get("camera", self.picture.get("camera"))
        if not isinstance(given, dict):
            raise self._fail("there is no 'camera', expected one for the person or the picture")
        size = (shape[1], shape[0])
        if "weak" in given:
            weak = self._numbers(given, "weak", (3,))
            ratio = float(self._numbers(given, "bbox_scale_ratio", ()))
            if weak[0] <= 0 or ratio <= 0:
                raise self._fail(
                    f"the camera's scale is {weak[0]:g} and 'bbox_scale_ratio' {ratio:g}, expected"
                    " more than 0"
                )
            return weak_perspective(weak, self._numbers(given, "bbox_top_left", (2,)), ratio, size)
        focal = given.get("focal_px")
        if not isinstance(focal, int | float) or not np.isfinite(focal) or focal <= 0:
            raise self._fail(
                f"the camera's 'focal_px' is {focal!r}, expected its focal length in pixels"
            )
        middle = np.array(size) / 2
        if "centre_px" in given:
            middle = self._numbers(given, "centre_px", (2,))
        to_camera = np.eye(4)
        if "world_to_camera" in given:
            to_camera = self._numbers(given, "world_to_camera", (4, 4))
        intrinsics = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]])
        return Camera(intrinsics, to_camera, *size)

    def _trans(self, gender: str, shape: np.ndarray) -> np.ndarray:
        """Place of the root joint; SMPL's translation is added to where it is without one."""
        if "trans" in self.entry:
            return self._numbers(self.entry, "trans", (3,))
        root = shape_body(self.bodies[gender], shape)[1][0].astype(np.float64)
        if "transl" in self.entry:
            return root + self._numbers(self.entry, "transl", (3,))
        if "weak" in self.entry.get("camera", self.picture.get("camera", {})):
            return root
        raise self._fail("there is neither 'trans' nor 'transl', expected the person's place")

    def _check_seen(self, person: Person) -> None:
        body = self.bodies[person.gender]
        posed, _ = posed_vertices(body, person.shape, person.pose[None], person.trans[None])
        image, depth = person.camera.project(posed[0].astype(np.float64))
        if (depth <= 0).all():
            raise self._fail("the body is behind the camera, expected it in the picture")
        size = np.array([person.camera.width, person.camera.height])
        inside = (depth > 0) & (image >= 0).all(axis=1) & (image < size).all(axis=1)
        if not inside.any():
            x, y = np.median(image[depth > 0], axis=0)
            raise self._fail(
                f"the body is at pixel ({x:.0f}, {y:.0f}), outside the picture of"
                f" {size[0]} x {size[1]} pixels"
            )

    def _garments(self, classes: np.ndarray, own: np.ndarray, least_px: int) -> tuple[str, ...]:
        count = garment_pixels(classes, own)
        wanted = self.entry.get("garments")
        if wanted is None:
            found = tuple(name for name, pixels in count.items() if pixels >= least_px)
            if not found:
                raise self._fail(
                    f"no garment has {least_px} pixels or more, expected at least one of"
                    f" {', '.join(GARMENT_CLASSES)}"
                )
            return found
        if not isinstance(wanted, list) or not all(isinstance(name, str) for name in wanted):
            raise self._fail(f"'garments' is {wanted!r:.60}, expected a list of classes")
        for name in wanted:
            if name not in GARMENT_CLASSES:
                raise self._fail(
                    f"'garments' has {name!r}, expected some of {', '.join(GARMENT_CLASSES)}"
                )
            if not count[name]:
                raise self._fail(f"'garments' has '{name}', but no pixel of the person shows one")
        return tuple(name for name in GARMENT_CLASSES if name in wanted)
