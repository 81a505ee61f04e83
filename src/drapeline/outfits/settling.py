"""A short settling under a little weight, so that garments hang instead of standing like moulds."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from drapeline.geometry.smoothing import averaging_matrix

# Light cloth that loses its speed at once: folds come from fullness, weight only directs them.
_FALL_M = 7e-5
_KEEP_SPEED = 0.6
_PROJECTIONS = 2
_SHEAR_STIFFNESS = 0.35
_FOLD_WIDTH_M = 0.018


def draped(
    start: np.ndarray,
    faces: np.ndarray,
    held: np.ndarray,
    keep_out: Callable[[np.ndarray], np.ndarray],
    *,
    fullness: np.ndarray,
    nudge: np.ndarray,
    steps: int,
) -> np.ndarray:
    """Let a garment (V, 3) settle with position-based dynamics.

    Args:
        faces: (F, 4), the first edge of each along the weft (around), the second along the warp.
        held: (V,) bool, vertices that stay.
        keep_out: moves points out of the dress form.
        fullness: (V,) excess of cloth around the body in shares; it makes the folds.
        nudge: (V, 3) metres, where folds begin.
        steps: number of steps.
    """
    weft = np.concatenate([faces[:, [0, 1]], faces[:, [2, 3]]])
    warp = np.concatenate([faces[:, [1, 2]], faces[:, [3, 0]]])
    shear = np.concatenate([faces[:, [0, 2]], faces[:, [1, 3]]])
    pairs = np.concatenate([weft, warp, shear])
    stiffness = np.ones(len(pairs))
    stiffness[-len(shear) :] = _SHEAR_STIFFNESS
    rest = np.linalg.norm(start[pairs[:, 0]] - start[pairs[:, 1]], axis=1)
    share = np.repeat([1.0, 0.15, 0.6], [len(weft), len(warp), len(shear)])
    rest *= 1 + share * fullness[pairs].mean(axis=1)
    count = len(start)
    rows, signs = np.repeat(np.arange(len(pairs)), 2), np.tile([1.0, -1.0], len(pairs))
    difference = sp.csr_matrix((signs, (rows, pairs.ravel())), shape=(len(pairs), count))
    weight = np.bincount(pairs.ravel(), np.repeat(stiffness, 2), count)
    # Jacobi projection: every vertex takes the weighted mean of what its springs ask for.
    gather = (sp.diags(0.6 / weight) @ difference.T @ sp.diags(stiffness)).tocsr()
    x, before = np.where(held[:, None], start, start + nudge), start
    for _ in range(steps):
        ahead = x + _KEEP_SPEED * (x - before) - [0.0, 0.0, _FALL_M]
        ahead[held] = start[held]
        before = x
        for _ in range(_PROJECTIONS):
            span = difference @ ahead
            length = np.sqrt(np.einsum("si,si->s", span, span))
            ahead += gather @ (span * (rest / np.maximum(length, 1e-9) - 1)[:, None])
            ahead[held] = start[held]
        x = keep_out(ahead)
    return x


def fold_seeds(
    rng: np.random.Generator, faces: np.ndarray, count: int, edge_length_m: float, size_m: float
) -> np.ndarray:
    """Random displacements (count, 3) metres, long along the warp and short along the weft.

    Args:
        size_m: their root mean square.
    """
    noise = rng.normal(size=(count, 3))
    along = averaging_matrix(faces[:, [1, 2, 2, 1]], count)
    around = averaging_matrix(faces[:, [0, 1, 1, 0]], count)
    # Averaging passes reach as far as the square root of their number.
    for average, reach_m in ((along, 0.08), (around, _FOLD_WIDTH_M)):
        for _ in range(max(1, round((reach_m / edge_length_m) ** 2 / 2))):
            noise = average @ noise
    return noise * (size_m / np.sqrt((noise**2).mean()))
