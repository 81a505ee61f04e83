"""Cloth evened out by a linear system that is factorised once per mesh."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from drapeline.mesh import edge_graph, rim_edges
from drapeline.outfits.relax import averaging_matrix


def symmetric_factor(system: sp.spmatrix) -> SuperLU:
    """Of a symmetric, positive definite matrix."""
    return splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})


def fairing(faces: np.ndarray, count: int, strength: float) -> Callable[[np.ndarray], np.ndarray]:
    """A function that evens out vertices (count, 3) of one mesh.

    It minimises |x - given|^2 + strength |x - Mx|^2, where M takes the mean of a vertex's
    neighbours, on a rim of those along the rim. What goes up and down within a few edges is taken
    out, wide folds stay, and unlike plain smoothing it draws no rim in.

    Args:
        faces: (F, 3).
        count: of vertices.
        strength: of the second term; folds as long as n edges lose half at 0.01 n^4.
    """
    rim = edge_graph(rim_edges(faces), count)
    on_rim = np.asarray(rim.sum(axis=1)).ravel()
    inner = sp.diags((on_rim == 0).astype(float)) @ averaging_matrix(faces, count)
    away = sp.eye(count) - inner - sp.diags(1 / np.maximum(on_rim, 1)) @ rim
    return symmetric_factor(sp.eye(count) + strength * away.T @ away).solve
