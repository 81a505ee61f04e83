"""The closed surface at a small distance around a garment, by marching cubes from coarse to fine.

An unsigned distance has no sign to tell one side of the cloth from the other, so the surface where
it equals a threshold is a closed skin around the cloth: two walls, joined around each opening.
SMPLicit's garments are such skins (Corona et al. 2021, 3.2).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skimage.measure import marching_cubes

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.fields import Field

# Cloth in the middle between two layers of a grid's points is half a cell from either: nothing of
# a thinner skin around it would be seen.
LEAST_THRESHOLD_CELLS = 0.55
# Values below this share of the clipped distance tell that cloth is near; learned ones waver there.
_SEEN = 0.9
_SQRT3 = float(np.sqrt(3.0))


@dataclass(frozen=True)
class Grid:
    """Points with the same spacing along each axis, the first of them at `low`.

    Attributes:
        low, high: (3,) corners in metres; the last points lie on `high`, or up to a cell beyond it.
        cell_m: spacing.
    """

    low: np.ndarray
    high: np.ndarray
    cell_m: float

    @cached_property
    def cells(self) -> tuple[int, int, int]:
        """Number of cells along each axis; there is one more point."""
        counts = np.ceil((np.asarray(self.high) - self.low) / self.cell_m - 1e-6).astype(int)
        return tuple(np.maximum(counts, 1).tolist())

    def places(self, index: np.ndarray) -> np.ndarray:
        """World coordinates (P, 3) float64 of indices (P, 3); halves are middles between points."""
        return np.asarray(self.low, dtype=np.float64) + self.cell_m * index


def extract_walls(
    field: Field, grid: Grid, threshold_m: float, *, clip_m: float = 0.03, lipschitz: float = 1.0
) -> Mesh:
    """The surface at a distance `threshold_m` from a garment, as on the full grid.

    Cloth is first looked for at points so far apart that only pieces of a few cells fit between
    them. From box to box it is then followed to where it ends, and boxes are divided further only
    where the field in their middle leaves it possible that the threshold is reached within them.
    Marching cubes after Lorensen and Cline (1987), with Lewiner's topology.

    Args:
        field: distances.
        grid: where to look; walls that leave it stay open there.
        threshold_m: distance of the walls from the cloth.
        clip_m: the greatest value that the field takes. It limits the size of the first boxes.
        lipschitz: how many metres the field changes by, at most, per metre of way; 1 for exact
            distances. A field that is steeper somewhere may lose parts of its walls there.

    Returns:
        Triangles, counter-clockwise seen from outside the walls; no faces if the field is
        nowhere as small as the threshold.

    Raises:
        InputError: the threshold is too small for the grid's cells, or not below `clip_m`.
    """
    if threshold_m < LEAST_THRESHOLD_CELLS * grid.cell_m:
        raise InputError(
            f"the threshold is {1e3 * threshold_m:g} mm, too small for cells of"
            f" {1e3 * grid.cell_m:g} mm; expected at least {LEAST_THRESHOLD_CELLS:g} cells"
        )
    if threshold_m >= clip_m:
        raise InputError(
            f"the threshold is {1e3 * threshold_m:g} mm; expected less than the"
            f" {1e3 * clip_m:g} mm at which the field is clipped"
        )
    values = _values(field, grid, threshold_m, clip_m, lipschitz)
    if not values.min() < threshold_m < values.max():
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    places, faces, _, _ = marching_cubes(values, threshold_m, gradient_direction="descent")
    return Mesh(grid.places(places).astype(np.float32), faces.astype(np.int32))


def _values(
    field: Field, grid: Grid, threshold_m: float, clip_m: float, lipschitz: float
) -> np.ndarray:
    """The field at the grid's points (X, Y, Z); far from the walls, something on the same side."""
    steepest = lipschitz * _SQRT3 / 2 * grid.cell_m  # change from a cell's middle to its corner
    size = _first_size((clip_m - threshold_m) / steepest)
    shape = tuple(-(-cells // size) for cells in grid.cells)
    values = np.full(shape, clip_m, np.float32)
    unsure = np.zeros(shape, bool)
    asked = _seeds(field, grid, size, shape, clip_m)
    known = asked.copy()
    while asked.any():
        values[asked] = _look(field, grid, (np.argwhere(asked) + 0.5) * size)
        unsure |= asked & _reached(values, threshold_m, steepest * size)
        asked = _beside(unsure) & ~known
        known |= asked
    while size > 3:
        factor = 3 if size % 2 else 2
        values, unsure = _divide(values, factor), _divide(unsure, factor)
        size //= factor
        values[unsure] = _look(field, grid, (np.argwhere(unsure) + 0.5) * size)
        unsure &= _reached(values, threshold_m, steepest * size)
    values, unsure = _divide(values, size), _divide(unsure, size)
    points = tuple(slice(cells + 1) for cells in grid.cells)
    values = np.pad(values, (0, 1), mode="edge")[points]
    near = _corners(unsure)[points]
    values[near] = _look(field, grid, np.argwhere(near))
    # A value on the threshold itself would give faces without area.
    values[values == np.float32(threshold_m)] = np.nextafter(np.float32(threshold_m), np.float32(1))
    return values


def _seeds(
    field: Field, grid: Grid, size: int, shape: tuple[int, ...], clip_m: float
) -> np.ndarray:
    """Which boxes of so many cells lie in one twice as large whose middle is near the cloth."""
    middles = np.indices([-(-count // 2) for count in shape]).reshape(3, -1).T * 2 + 1
    near = _look(field, grid, middles * size) < _SEEN * clip_m
    near = near.reshape([-(-count // 2) for count in shape])
    return _divide(near, 2)[tuple(map(slice, shape))]


def _reached(values: np.ndarray, threshold_m: float, change_m: float) -> np.ndarray:
    """Where values that change by so much, at most, may reach the threshold."""
    return np.abs(values - threshold_m) <= change_m * (1 + 1e-4)


def _beside(boxes: np.ndarray) -> np.ndarray:
    """The boxes (X, Y, Z) that share a face with some of the boxes."""
    found = np.zeros_like(boxes)
    for axis in range(3):
        here, there = np.swapaxes(boxes, 0, axis), np.swapaxes(found, 0, axis)
        there[1:] |= here[:-1]
        there[:-1] |= here[1:]
    return found


def _first_size(most: float) -> int:
    """The greatest product of twos and threes up to a number, at least 1."""
    sizes = [2**i * 3**j for i in range(10) for j in range(6)]
    return max(size for size in sizes if size <= max(most, 1))


def _look(field: Field, grid: Grid, index: np.ndarray) -> np.ndarray:
    return field.distances(grid.places(index).astype(np.float32))


def _divide(boxes: np.ndarray, factor: int) -> np.ndarray:
    """Each box's value for all the boxes it is divided into."""
    for axis in range(3):
        boxes = np.repeat(boxes, factor, axis=axis)
    return boxes


def _corners(cells: np.ndarray) -> np.ndarray:
    """The points (X + 1, Y + 1, Z + 1) that are corners of some of the cells (X, Y, Z)."""
    points = np.pad(cells, (0, 1))
    for axis in range(3):
        points |= np.roll(points, 1, axis=axis)  # what is rolled over is the padding
    return points
