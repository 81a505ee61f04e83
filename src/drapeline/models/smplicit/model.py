"""A trained model as users of the library take it: codes in, meshes out.

    from drapeline.models.smplicit.model import SmplicitModel

    upper = SmplicitModel("results/smplicit/upper")
    garment = upper.decode(upper.codes.z[0], gender="female", shape=[0.0] * 10)

Everything comes from the folder that the training left, see `files`. Meshes are in metres, in the
rest pose, with the root joint at the origin, Z up, facing -Y. The numbers of a code are z_cut
followed by z_style.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel, load_body
from drapeline.bodies.rest_body import SHAPES, rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, face_normals
from drapeline.models.smplicit.fields import Field
from drapeline.models.smplicit.files import body_file, load_training_codes
from drapeline.models.smplicit.latent import draw_between
from drapeline.models.smplicit.load import load_field
from drapeline.models.smplicit.network_field import NetworkField
from drapeline.models.smplicit.settings import Meshing
from drapeline.models.smplicit.sheet import extract_sheet
from drapeline.models.smplicit.variants import FIELD_MODELS, Box
from drapeline.models.smplicit.walls import Grid, extract_walls
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for

# No garment at rest is further from the body; the widest skirts are 30 cm from the legs.
REACH_M = 0.35
_BLOCK_M = 0.06
_LEAF = 32  # vertices in a tree's leaf; for points far from all of them twice as fast as 10


class FieldGarment(NamedTuple):
    """A garment of a code on a body at rest.

    Attributes:
        sheet: one layer, open at the garment's openings; no faces if nothing is left of it.
        walls: the closed surface of the paper, on both sides of the cloth.
    """

    sheet: Mesh
    walls: Mesh


class SmplicitModel:
    """Garments of some types as codes of a distance field.

    Args:
        folder: of the training, such as `results/smplicit/upper`.

    Attributes:
        name: of `FIELD_MODELS`.
        garments: the types that it was trained on.
        network: in torch, see `GarmentField`.
        codes: of the training garments.

    Raises:
        InputError: a file is missing or damaged, or holds another model.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.network = load_field(folder)
        self.codes = load_training_codes(folder)
        self.name = self.network.name
        self.garments, self.box = FIELD_MODELS[self.name][:2]

    @property
    def latent(self) -> int:
        """Numbers of a code."""
        return self.codes.z.shape[1]

    @property
    def mean_code(self) -> np.ndarray:
        """(cut + style,) mean of the training garments' codes."""
        return self.codes.z.mean(axis=0)

    def codes_of(self, garment: str) -> np.ndarray:
        """(n, cut + style) codes of the training garments of a type; of all if there are none."""
        own = self.codes.garment == GARMENTS.index(garment)
        return self.codes.z[own] if own.any() else self.codes.z

    @cached_property
    def bodies(self) -> dict[str, BodyModel]:
        """The bodies that it was trained on, by gender."""
        return {gender: load_body(body_file(self.folder, gender)) for gender in GENDERS}

    def sample(self, count: int, *, seed: int = 0) -> np.ndarray:
        """(count, cut + style) codes of new garments; see `draw_between`."""
        return draw_between(self.codes.z, self.codes.garment, rng_for(seed, "samples"), count)

    def field(self, z: np.ndarray, *, gender: str, shape: Sequence[float]) -> NetworkField:
        """The distance field of a code on a body.

        Args:
            z: (cut + style,) code.
            gender: of the wearer, "female" or "male".
            shape: (10,) of the wearer.

        Raises:
            InputError: the code or the shape has another length or is not finite, or there is no
                such gender.
        """
        z = finite("code", z, self.latent)
        check_gender(gender)
        return NetworkField(self.network, z, finite("shape", shape, SHAPES), GENDERS.index(gender))

    def decode(
        self,
        z: np.ndarray,
        *,
        gender: str,
        shape: Sequence[float],
        meshing: Meshing | None = None,
    ) -> FieldGarment:
        """The garment of a code on a body; see `field` for arguments and errors."""
        field = self.field(z, gender=gender, shape=shape)
        body = Mesh(rest_body(self.bodies[gender], np.asarray(shape)), self.bodies[gender].faces)
        return garment_of_field(field, self.box, body, meshing or Meshing())


def garment_of_field(field: Field, box: Box, body: Mesh, meshing: Meshing) -> FieldGarment:
    """Walls and sheet of a field.

    Args:
        field: of the garment.
        box: lowest and highest corner, metres.
        body: the wearer at rest, triangles.
        meshing: cell and threshold.
    """
    low, high = np.asarray(box)
    near = NearBody(field, box, body.vertices)
    walls = extract_walls(near, Grid(low, high, meshing.cell_m), meshing.threshold_m)
    outward = away_from_body(walls.vertices, body)
    return FieldGarment(extract_sheet(field, walls, meshing.threshold_m, outward), walls)


class NearBody:
    """A field that is evaluated only where cloth can be; elsewhere it is `REACH_M`.

    Args:
        field: within the box.
        box: lowest and highest corner, metres.
        body: (V, 3) the wearer.
    """

    def __init__(self, field: Field, box: Box, body: np.ndarray) -> None:
        self._field, self._low, self.clip_m = field, np.asarray(box[0]), field.clip_m
        counts = np.ceil((np.asarray(box[1]) - self._low) / _BLOCK_M).astype(int) + 1
        centres = np.stack(np.indices(counts), axis=-1).reshape(-1, 3) + 0.5
        reach = REACH_M + _BLOCK_M * 3**0.5 / 2
        tree = KDTree(body, leafsize=_LEAF)
        away, _ = tree.query(self._low + _BLOCK_M * centres, distance_upper_bound=reach)
        self._near = np.isfinite(away).reshape(counts)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """(P,) metres of points (P, 3) within the box."""
        block = ((points - self._low) / _BLOCK_M).astype(int)
        near = self._near[tuple(np.clip(block, 0, np.array(self._near.shape) - 1).T)]
        found = np.full(len(points), REACH_M, dtype=np.float32)
        found[near] = self._field.distances(points[near])
        return found

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the field itself."""
        return self._field.gradients(points)


def away_from_body(points: np.ndarray, body: Mesh) -> np.ndarray:
    """(P, 3) normals of the body's nearest faces."""
    _, face = closest_points(points, body.vertices, body.faces)
    return face_normals(body.vertices, body.faces[face])


def check_gender(gender: str) -> None:
    """Refuse other genders than the bodies'.

    Raises:
        InputError: there is no such gender.
    """
    if gender not in GENDERS:
        raise InputError(f"gender: '{gender}', expected one of {', '.join(GENDERS)}")


def finite(name: str, values: Sequence[float] | np.ndarray, size: int) -> np.ndarray:
    """(size,) float32 numbers.

    Raises:
        InputError: they are not finite, or not as many.
    """
    array = np.asarray(values, dtype=np.float32)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name}: shape {array.shape}, expected {size} finite numbers")
    return array
