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
from drapeline.models.smplicit.surface.fields import DistanceField

# Cloth in the middle between two layers of a grid's points is half a cell from either: nothing of
# a thinner skin around it would be seen.
LEAST_THRESHOLD_CELLS = 0.55
# Values below this share of the clipped distance tell that cloth is near; learned ones waver there.
_SEEN = 0.9
_FIRST_SPACING = 1.6  # of the points at which cloth is looked for, in clipped distances


@dataclass(frozen=True)
class Grid:
    """Points with the same spacing along each axis, the first of them at `low`."""

    # low, high: (3,) corners in metres; the last points lie on `high`, or up to a cell beyond it.
    low: np.ndarray
    high: np.ndarray
    cell_m: float  # spacing

    @cached_property
    def cells(self) -> tuple[int, int, int]:
        """Number of cells along each axis; there is one more point."""
        counts = np.ceil((np.asarray(self.high) - self.low) / self.cell_m - 1e-6).astype(int)
        return tuple(np.maximum(counts, 1).tolist())

    def places(self, index: np.ndarray) -> np.ndarray:
        """World coordinates (P, 3) float64 of points with indices (P, 3)."""
        return np.asarray(self.low, dtype=np.float64) + self.cell_m * index


def extract_walls(field: DistanceField, grid: Grid, threshold_m: float) -> Mesh:
    """The surface at a distance `threshold_m` from a garment, as on the full grid.

    Cloth is first looked for at points so far apart that only pieces of a few centimetres fit
    between them. From there the inside of the walls is followed from point to point, as in
    Bloomenthal (1988), to where it ends; no other point is looked at. Marching cubes after Lorensen
    and Cline (1987), with Lewiner's topology.

    Args:
        grid: where to look; walls that leave it stay open there.
        threshold_m: distance of the walls from the cloth.

    Returns:
        Triangles, counter-clockwise seen from outside the walls; no faces if the field is
        nowhere as small as the threshold.

    Raises:
        InputError: the threshold is too small for the grid's cells, or not below the field's
            greatest distance.
    """
    if threshold_m < LEAST_THRESHOLD_CELLS * grid.cell_m:
        raise InputError(
            f"the threshold is {1e3 * threshold_m:g} mm, too small for cells of"
            f" {1e3 * grid.cell_m:g} mm; expected at least {LEAST_THRESHOLD_CELLS:g} cells"
        )
    if threshold_m >= field.clip_m:
        raise InputError(
            f"the threshold is {1e3 * threshold_m:g} mm; expected less than the"
            f" {1e3 * field.clip_m:g} mm at which the field is clipped"
        )
    values = _values(field, grid, threshold_m)
    if not values.min() < threshold_m < values.max():
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    places, faces, _, _ = marching_cubes(values, threshold_m, gradient_direction="descent")
    return Mesh(grid.places(places).astype(np.float32), faces.astype(np.int32))


def _values(field: DistanceField, grid: Grid, threshold_m: float) -> np.ndarray:
    """The field at the grid's points (X, Y, Z) within the walls and next to them, else `clip_m`."""
    clip_m = field.clip_m
    shape = tuple(cells + 1 for cells in grid.cells)
    values, known = np.full(shape, clip_m, np.float32), np.zeros(shape, bool)

    def evaluate(asked: np.ndarray) -> None:
        values[asked] = field.distances(grid.places(np.argwhere(asked)).astype(np.float32))
        known[asked] = True

    stride = max(round(_FIRST_SPACING * clip_m / grid.cell_m), 1)
    first = np.zeros(shape, bool)
    first[tuple(slice(min(stride // 2, count - 1), None, stride) for count in shape)] = True
    evaluate(first)
    near = np.argwhere(first & (values < _SEEN * clip_m))
    asked = _around(_on_cloth(field, grid, near), shape) & ~known
    while asked.any():
        evaluate(asked)
        asked = _around(np.argwhere(asked & (values < threshold_m)), shape) & ~known
    # A value on the threshold itself would give faces without area.
    values[values == np.float32(threshold_m)] = np.nextafter(np.float32(threshold_m), np.float32(1))
    return values


def _on_cloth(field: DistanceField, grid: Grid, index: np.ndarray) -> np.ndarray:
    """Indices (P, 3) of the grid's points where the gradient leads from others (Chibane 2020)."""
    places = grid.places(index)
    distances, ways = field.gradients(places.astype(np.float32))
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    there = places - distances[:, None] * ways
    index = np.rint((there - grid.low) / grid.cell_m).astype(int)
    return np.clip(index, 0, grid.cells)


def _around(index: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(X, Y, Z) where points (P, 3) of a grid and their 26 neighbours are."""
    found = np.zeros([count + 2 for count in shape], bool)
    for step in np.ndindex(3, 3, 3):
        found[tuple((index + step).T)] = True
    return found[1:-1, 1:-1, 1:-1]
