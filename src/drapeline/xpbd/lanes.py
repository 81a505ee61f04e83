"""Lanes: several constraints or vertices at once, one in each lane of a vector register."""

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


def lay_in_lanes(values: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    """Values (C, K) by lane: (R, K, LANES). An empty lane repeats its row's first.

    Args:
        values: (C, K).
        lanes: (R, LANES), see `fill_lanes`.
    """
    numbers = np.where(lanes < 0, lanes[:, :1], lanes)
    return np.ascontiguousarray(np.swapaxes(values[numbers], 1, 2))


@wp.func
def dot_lanes(x: Lanes, y: Lanes, z: Lanes, u: Lanes, v: Lanes, w: Lanes):
    """Products of two vectors in each lane, given by axis."""
    return wp.cw_mul(x, u) + wp.cw_mul(y, v) + wp.cw_mul(z, w)
