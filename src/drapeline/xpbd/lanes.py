"""Lanes: several points or constraints at once, one in each lane of a vector register."""

import numpy as np
import warp as wp

LANES = 8
Lanes = wp.types.vector(LANES, wp.float32)
LaneIndices = wp.types.vector(LANES, wp.int32)
# Warp counts negative indices from the end. Ours are none, as this mask tells the compiler, which
# would otherwise check lane by lane.
NOT_NEGATIVE = wp.constant(0x7FFFFFFF)


def fill_lanes(colours: np.ndarray) -> np.ndarray:
    """Rows (R, LANES) of constraints to be solved at once: their numbers, -1 for an empty lane.

    Args:
        colours: (C,) int, sorted; those of a row are equal.
    """
    starts = np.flatnonzero(np.diff(colours, prepend=-1))
    sizes = np.diff(starts, append=len(colours))
    rows = -(-sizes // LANES)
    before = np.concatenate([[0], np.cumsum(rows)])
    lanes = np.full((before[-1], LANES), -1, dtype=np.int32)
    numbers = np.arange(len(colours))
    lanes.ravel()[numbers + np.repeat(LANES * before[:-1] - starts, sizes)] = numbers
    return lanes


def repeat_first(lanes: np.ndarray) -> np.ndarray:
    """Rows (R, LANES) of numbers whose empty lanes, -1, have that of their row's first."""
    return np.where(lanes < 0, lanes[:, :1], lanes)


def lay_in_lanes(values: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    """Values (C, K) by lane: (R, K, LANES). An empty lane repeats its row's first.

    Args:
        values: (C, K).
        lanes: (R, LANES), see `fill_lanes` and `make_patches`.
    """
    return np.ascontiguousarray(np.swapaxes(values[repeat_first(lanes)], 1, 2))


def make_patches(points: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Rows (R, LANES) of points that lie together: their numbers, -1 for an empty lane.

    Args:
        points: (P, 3).
        groups: (P,) int; those of a row are equal.
    """
    parts = [
        part
        for group in np.unique(groups)
        for part in _bisect(points, np.flatnonzero(groups == group))
    ]
    patches = np.full((len(parts), LANES), -1, dtype=np.int32)
    for patch, part in zip(patches, parts, strict=True):
        patch[: len(part)] = part
    return patches


def _bisect(points: np.ndarray, chosen: np.ndarray) -> list[np.ndarray]:
    if len(chosen) <= LANES:
        return [chosen]
    axis = np.argmax(np.ptp(points[chosen], axis=0))
    half = LANES * -(-len(chosen) // (2 * LANES))
    order = chosen[np.argpartition(points[chosen, axis], half - 1)]
    return [*_bisect(points, order[:half]), *_bisect(points, order[half:])]


@wp.func
def gather_lanes(values: wp.array(dtype=wp.vec3), which: LaneIndices):
    """Vectors by axis: three numbers in each lane."""
    x = Lanes()
    y = Lanes()
    z = Lanes()
    for k in range(LANES):
        value = values[which[k] & NOT_NEGATIVE]
        x[k] = value[0]
        y[k] = value[1]
        z[k] = value[2]
    return x, y, z


# Warp's own maximum of two vectors looks out for NaN, lane by lane.
@wp.func_native(
    """
    wp::vec_t<LANES, wp::float32> most;
    for (int k = 0; k < LANES; ++k) most[k] = a[k] > b[k] ? a[k] : b[k];
    return most;
    """.replace("LANES", str(LANES))
)
def most(a: Lanes, b: Lanes) -> Lanes:
    """The larger of two numbers in each lane; neither may be NaN."""
    ...


@wp.func_native(
    """
    int count = 0;
    for (int k = 0; k < LANES; ++k) count += a[k] < b[k] ? 1 : 0;
    return count;
    """.replace("LANES", str(LANES))
)
def count_less(a: Lanes, b: Lanes) -> int:
    """In how many lanes the first number is less than the second."""
    ...


@wp.func
def dot_lanes(x: Lanes, y: Lanes, z: Lanes, u: Lanes, v: Lanes, w: Lanes):
    """Products of two vectors in each lane, given by axis."""
    return wp.cw_mul(x, u) + wp.cw_mul(y, v) + wp.cw_mul(z, w)
