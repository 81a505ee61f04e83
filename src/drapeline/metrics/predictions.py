"""Single garments with their predictions, as figures show them."""

from typing import NamedTuple

import numpy as np

from drapeline.geometry.mesh import Mesh


class GarmentCase(NamedTuple):
    """A garment before registration, after it, and as predicted.

    Attributes:
        label: its name in a picture.
        original: the garment as made or simulated, triangles, root-relative metres.
        true: (V, 3) registered vertices, garment within `mask` (V,).
        mask: (V,) bool.
        predicted: (V, 3).
        predicted_mask: (V,) bool; the true one if the model predicts none.
        faces: (F, 3) of the garment's topology.
        wearer: the whole body in the same pose.
        root_rotation: (3,) axis-angle of the wearer's root joint, rad.
    """

    label: str
    original: Mesh
    true: np.ndarray
    mask: np.ndarray
    predicted: np.ndarray
    predicted_mask: np.ndarray
    faces: np.ndarray
    wearer: Mesh
    root_rotation: np.ndarray


class WornGarment(NamedTuple):
    """A garment on its wearer.

    Attributes:
        garment_type: one of `GARMENTS`.
        garment: metres, in the frame of its wearer.
        wearer: the whole body in the same pose.
        root_rotation: (3,) axis-angle of the wearer's root joint, rad.
    """

    garment_type: str
    garment: Mesh
    wearer: Mesh
    root_rotation: np.ndarray


class RebuiltGarment(NamedTuple):
    """A held-out garment with its surfaces, all at rest.

    Attributes:
        label: names it.
        garment: its type.
        original: as it was made.
        sheet, walls: of the field of its code.
        mean: the open surface of the mean code on the same body.
        wearer: the body.
    """

    label: str
    garment: str
    original: Mesh
    sheet: Mesh
    walls: Mesh
    mean: Mesh
    wearer: Mesh


class GalleryGarment(NamedTuple):
    """A garment of a gallery of SMPLicit.

    Attributes:
        sheet: the picture that it is part of.
        row, column: its place there, by their titles, which may have several lines.
        caption: below it.
        garment: its type, one of `GARMENTS`.
        mesh: triangles at rest, root-relative metres; no faces if nothing was made.
        wearer: the whole body at rest.
    """

    sheet: str
    row: str
    column: str
    caption: str
    garment: str
    mesh: Mesh
    wearer: Mesh
