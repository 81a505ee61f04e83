"""Mean and deviation per body vertex, of offsets where they are worn and of bodies."""

from collections.abc import Iterable

import numpy as np

# Where cloth hardly varies the deviation is tiny: dividing by it would blow up a millimetre to the
# size of a sleeve.
OFFSET_STD_FLOOR_M = 0.005
BODY_STD_FLOOR_M = 0.01


def offset_statistics(
    rows: Iterable[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (V, 3) float32 of offsets where masked.

    Args:
        rows: offsets (V, 3) in metres and mask (V,) of each garment, at least one.

    Returns:
        The deviation is at least `OFFSET_STD_FLOOR_M`; a vertex that fewer than two garments cover
        takes the median of the others'.
    """
    count = total = square = np.zeros(())
    for offsets, mask in rows:
        worn = np.where(mask[:, None], offsets, 0).astype(np.float64)
        count, total, square = count + mask[:, None], total + worn, square + worn**2
    mean, std = _moments(np.maximum(count, 1), total, square)
    enough = count[:, 0] > 1
    if enough.any():
        std[~enough] = np.median(std[enough], axis=0)
    return mean.astype(np.float32), np.maximum(std, OFFSET_STD_FLOOR_M).astype(np.float32)


def body_statistics(bodies: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (V, 3) float32 of bodies (V, 3), the latter at least the floor."""
    count = total = square = np.zeros(())
    for body in bodies:
        wide = body.astype(np.float64)
        count, total, square = count + 1, total + wide, square + wide**2
    mean, std = _moments(count, total, square)
    return mean.astype(np.float32), np.maximum(std, BODY_STD_FLOOR_M).astype(np.float32)


def _moments(
    count: np.ndarray, total: np.ndarray, square: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    mean = total / count
    return mean, np.sqrt(np.maximum(square / count - mean**2, 0))
