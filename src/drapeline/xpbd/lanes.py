"""Lanes: several points or constraints at once, one in each lane of a vector register.

A processor takes `LANES` at once; a GPU, whose threads are its lanes, takes one in each thread.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

LANES = 8
# Warp counts negative indices from the end. Ours are none, as this mask tells the compiler, which
# would otherwise check lane by lane.
_NOT_NEGATIVE = wp.constant(0x7FFFFFFF)


def lane_types(width: int) -> tuple[type, type]:
    """Warp's types of a number, and of an index, in each of so many lanes."""
    return wp.types.vector(width, wp.float32), wp.types.vector(width, wp.int32)


def fill_lanes(colours: np.ndarray, width: int) -> np.ndarray:
    """Rows (R, width) of constraints to be solved at once: their numbers, -1 for an empty lane.

    Args:
        colours: (C,) int, sorted; those of a row are equal.
    """
    starts = np.flatnonzero(np.diff(colours, prepend=-1))
    sizes = np.diff(starts, append=len(colours))
    rows = -(-sizes // width)
    before = np.concatenate([[0], np.cumsum(rows)])
    lanes = np.full((before[-1], width), -1, dtype=np.int32)
    numbers = np.arange(len(colours))
    lanes.ravel()[numbers + np.repeat(width * before[:-1] - starts, sizes)] = numbers
    return lanes


def repeat_first(lanes: np.ndarray) -> np.ndarray:
    """Rows (R, width) of numbers whose empty lanes, -1, have that of their row's first."""
    return np.where(lanes < 0, lanes[:, :1], lanes)


def lay_in_lanes(values: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    """Values (C, K) by lane: (R, K, width). An empty lane repeats its row's first.

    Args:
        values: (C, K).
        lanes: (R, width), see `fill_lanes` and `make_patches`.
    """
    return np.ascontiguousarray(np.swapaxes(values[repeat_first(lanes)], 1, 2))


def make_patches(points: np.ndarray, groups: np.ndarray, width: int) -> np.ndarray:
    """Rows (R, width) of points that lie together: their numbers, -1 for an empty lane.

    Args:
        points: (P, 3).
        groups: (P,) int; those of a row are equal.
    """
    parts = [
        part
        for group in np.unique(groups)
        for part in _bisect(points, np.flatnonzero(groups == group), width)
    ]
    patches = np.full((len(parts), width), -1, dtype=np.int32)
    for patch, part in zip(patches, parts, strict=True):
        patch[: len(part)] = part
    return patches


def _bisect(points: np.ndarray, chosen: np.ndarray, width: int) -> list[np.ndarray]:
    if len(chosen) <= width:
        return [chosen]
    axis = np.argmax(np.ptp(points[chosen], axis=0))
    half = width * -(-len(chosen) // (2 * width))
    order = chosen[np.argpartition(points[chosen, axis], half - 1)]
    return [*_bisect(points, order[:half], width), *_bisect(points, order[half:], width)]


def overload_lanes(kernel: wp.Kernel, *, numbers: Sequence[str], indices: Sequence[str]) -> None:
    """Compile a kernel for a processor's lanes with its module, not when it is first launched.

    Args:
        kernel: takes arrays of lanes of any width.
        numbers, indices: which of its arguments are those.
    """
    number, index = lane_types(LANES)
    types = dict(kernel.adj.arg_types)
    for names, kind in ((numbers, number), (indices, index)):
        for name in names:
            types[name] = wp.array(dtype=kind, ndim=types[name].ndim)
    wp.overload(kernel, types)


@wp.func
def gather_lanes(values: wp.array(dtype=wp.vec3), which: Any, like: Any):
    """Vectors by axis: three numbers in each lane."""
    x = type(like)()
    y = type(like)()
    z = type(like)()
    for k in range(len(like)):
        value = values[which[k] & _NOT_NEGATIVE]
        x[k] = value[0]
        y[k] = value[1]
        z[k] = value[2]
    return x, y, z


# Warp's own maximum of two vectors looks out for NaN, lane by lane.
@wp.func
def most(a: Any, b: Any):
    """The larger of two numbers in each lane; neither may be NaN."""
    larger = type(a)()
    for k in range(len(a)):
        larger[k] = wp.where(a[k] > b[k], a[k], b[k])
    return larger


@wp.func
def count_less(a: Any, b: Any):
    """In how many lanes the first number is less than the second."""
    count = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    for k in range(len(a)):
        count += wp.where(a[k] < b[k], 1, 0)
    return count


@wp.func
def dot_lanes(x: Any, y: Any, z: Any, u: Any, v: Any, w: Any):
    """Products of two vectors in each lane, given by axis."""
    return wp.cw_mul(x, u) + wp.cw_mul(y, v) + wp.cw_mul(z, w)
