"""What a network sees of a person's garment in a picture (CLOTH3D 5.3).

The paper shows it the segments of the body and the silhouette of the garment, and takes the body's
shape and pose for known. Where the body is known, so is what lies beneath the cloth: here each
pixel tells which segment of the bare body is there, and also whether skin, the garment, or
something that hides it is seen. Pictures are cut to the body first. R pixels are a view's width and
height.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES, rest_body
from drapeline.models.pictures.read import BODY, CLASSES, UNKNOWN, Person, Picture
from drapeline.rendering.camera import Camera
from drapeline.rendering.modalities import cast_rays

# Of a view as the network takes it: three that tell segments of the body apart, whether the body is
# there, then whether skin, the garment, or what hides it is seen.
CHANNELS = 7
_SEEN = slice(4, 7)
_MARGIN = 1.15  # cloth reaches beyond the body
_SCALE = 127  # of numbers from -1 to 1 as bytes


class PersonView(NamedTuple):
    """A person, and what a picture shows of them."""

    # (R, R, 4) int8: the marks of the bare body, and whether it is there, times 127.
    body: np.ndarray
    classes: np.ndarray  # (R, R) uint8 indices into `CLASSES`


def body_marks(body: BodyModel) -> np.ndarray:
    """(V, 3) float32, -1 to 1, by which the segments of a body are told apart.

    They are where the middle of a vertex's segment is on the mean body at rest, as shares of the
    body's extent. The first has the other sign on the other side of the body.
    """
    rest = rest_body(body, np.zeros(SHAPES))
    _, segment, size = np.unique(body.segmentation, return_inverse=True, return_counts=True)
    middle = np.zeros((len(size), 3))
    np.add.at(middle, segment, rest / np.abs(rest).max(axis=0))
    return (middle / size[:, None])[segment].astype(np.float32)


def cut_to_body(camera: Camera, body: np.ndarray, size_px: int) -> Camera:
    """The same view, cut and scaled to a square picture that a body (V, 3) fills.

    Args:
        camera: that sees some of the body.
        size_px: width and height of the square.
    """
    image, depth = camera.project(body)
    image = image[depth > 0]
    low, high = image.min(axis=0), image.max(axis=0)
    side = _MARGIN * float((high - low).max())
    left, top = (low + high) / 2 - side / 2
    cut = np.array([[1, 0, -left], [0, 1, -top], [0, 0, side / size_px]]) * size_px / side
    return replace(camera, intrinsics=cut @ camera.intrinsics, width=size_px, height=size_px)


def pixels_of_cut(camera: Camera, cut: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Rows (R,) and columns (R,) of a camera's picture that the rays of a cut of it pass through.

    Those beyond the picture are -1.
    """
    before, after = camera.intrinsics, cut.intrinsics
    middle = np.arange(cut.width) + 0.5 - after[:2, 2, None]
    column, row = np.floor(before[0, 0] / after[0, 0] * middle + before[:2, 2, None]).astype(int)
    return (
        np.where((row >= 0) & (row < camera.height), row, -1),
        np.where((column >= 0) & (column < camera.width), column, -1),
    )


def see_body(body: PosedBody, marks: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 4) int8: what a camera sees of the bare body, see `PersonView`.

    Marks (V, 3) are those of `body_marks`.
    """
    seen = cast_rays([(body.posed, body.faces, marks)], camera)
    there = (seen.segments > 0)[..., None]
    return np.round(_SCALE * np.concatenate([seen.carried * there, there], axis=2)).astype(np.int8)


def view_person(
    picture: Picture, person: Person, body: PosedBody, marks: np.ndarray, size_px: int
) -> PersonView:
    """A person of a picture as the network sees them.

    Pixels of other people, and those beyond the picture, are of unknown things.

    Args:
        body: the person's.
        marks: (V, 3) of `body_marks`.
        size_px: width and height of the view.
    """
    camera = cut_to_body(person.camera, body.posed, size_px)
    classes = np.where(person.others, CLASSES.index(UNKNOWN), picture.classes)
    row, column = pixels_of_cut(person.camera, camera)
    rows, columns = row >= 0, column >= 0
    found = np.full((size_px, size_px), CLASSES.index(UNKNOWN), dtype=np.uint8)
    found[np.ix_(rows, columns)] = classes[np.ix_(row[rows], column[columns])]
    return PersonView(see_body(body, marks, camera), found)


def network_images(views: PersonView, kinds: np.ndarray) -> np.ndarray:
    """(B, CHANNELS, R, R) float32 images of garments of B views.

    Args:
        views: of all of them, (B, R, R, 4) and (B, R, R).
        kinds: (B,) classes of the garments, indices into `CLASSES`.
    """
    classes, kind = views.classes, np.asarray(kinds)[:, None, None]
    hidden = (classes == CLASSES.index(UNKNOWN)) | (classes > kind)  # by what is worn over it
    seen = np.stack([classes == CLASSES.index(BODY), classes == kind, hidden], axis=1)
    body = np.moveaxis(views.body, 3, 1).astype(np.float32) / _SCALE
    return np.concatenate([body, seen.astype(np.float32)], axis=1)


def join_views(views: Sequence[PersonView]) -> PersonView:
    """Several views of one size as the arrays of all of them."""
    return PersonView(*(np.stack(part) for part in zip(*views, strict=True)))


def hide_parts(images: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """Images (B, CHANNELS, R, R), half of them with a box of something unknown in them.

    In pictures of streets there are other people, bags and edges.
    """
    hidden, size = images.clone(), images.shape[-1]
    for image in hidden:
        height, width = rng.integers(size // 10, size // 2, 2)
        top, left = rng.integers(size - height), rng.integers(size - width)
        if rng.random() < 0.5:
            box = image[:, top : top + height, left : left + width]
            box[_SEEN] = torch.tensor([0.0, 0.0, 1.0]).to(box)[:, None, None]
    return hidden


def mirror_images(images: torch.Tensor) -> torch.Tensor:
    """The images (B, CHANNELS, R, R) of mirrored people."""
    flipped = images.flip(3)
    flipped[:, 0] *= -1
    return flipped
