"""Weighted least squares by Gauss-Newton steps, also of absolute values, and sparse factors."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

_DAMPING = 1e-3


class LeastSquares:
    """Normal equations of weighted residuals.

    Args:
        size: number of unknowns.
    """

    def __init__(self, size: int) -> None:
        self.matrix, self.right = np.zeros((size, size)), np.zeros(size)

    def add(
        self, slopes: np.ndarray, residual: np.ndarray, weight: np.ndarray | float, *places: slice
    ) -> None:
        """Add squares.

        Args:
            slopes: (P, n) derivatives by some of the unknowns.
            residual: (P,).
            weight: (P,) of the squares, or one for all.
            places: which unknowns the columns are, in order; the first n if not given.
        """
        if not places:
            places = (slice(0, slopes.shape[1]),)
        columns = np.concatenate([np.arange(len(self.right))[place] for place in places])
        weighted = slopes.T * weight
        self.matrix[np.ix_(columns, columns)] += weighted @ slopes
        self.right[columns] += weighted @ residual

    def add_prior(self, place: slice, residual: np.ndarray, weight: np.ndarray | float) -> None:
        """Add squares of the unknowns themselves, which are at `residual` now."""
        index = np.arange(len(self.right))[place]
        self.matrix[index, index] += weight
        self.right[index] += weight * residual

    def step(self, damping: float = _DAMPING) -> np.ndarray:
        """The change of the unknowns that leads to the least sum."""
        damped = self.matrix + damping * np.diag(self.matrix.diagonal())
        return -np.linalg.solve(damped, self.right)


def absolute_weights(residual: np.ndarray, floor: float) -> np.ndarray:
    """Weights by which squares of residuals stand for their absolute values."""
    return 1 / np.maximum(np.abs(residual), floor)


def symmetric_factor(system: sp.sparray | sp.spmatrix) -> SuperLU:
    """Factor a symmetric, positive definite matrix; solve with the result's `solve`.

    SuperLU's symmetric mode with minimum degree ordering of A^T + A: far less fill-in than its
    defaults leave in the Laplacians of meshes.
    """
    return splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
