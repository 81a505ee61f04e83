"""Factors of sparse systems."""

import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu


def symmetric_factor(system: sp.sparray | sp.spmatrix) -> SuperLU:
    """Of a symmetric, positive definite matrix."""
    return splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
