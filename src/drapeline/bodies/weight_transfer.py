"""Skinning weights of a garment, taken from the body that wears it.

`nearest_weights` follows the few body vertices under the cloth, as CLOTH3D's garments do;
`interpolated_weights` are Garment4D's (equation 2), blended from hundreds of vertices around.
"""

from typing import Literal

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from drapeline.geometry.mesh import vertex_normals
from drapeline.geometry.nearest_points import nearest_points
from drapeline.geometry.smoothing import averaging_matrix, blur

# Keeps distances in metres from vanishing, so that one close vertex does not outweigh all others.
_SMALL_M = 1e-6
_COINCIDENT_M = 1e-9
_NEAREST = 8
# Distance that a turn of the normal by one radian counts for, as in registration: a sleeve does
# not take after the torso beside it.
_TURN_M = 0.1
_PASSES = 20


def nearest_weights(
    garment: np.ndarray,
    faces: np.ndarray,
    body: np.ndarray,
    body_faces: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """Weights of the nearest body vertices that face the same way, smoothed over the garment.

    Args:
        garment: (V, 3) metres, in the body's rest pose.
        faces: (F, 3) of the garment.
        body: (B, 3) in the rest pose.
        body_faces: (G, 3).
        weights: (B, K) of the body, rows sum to 1.

    Returns:
        (V, K) float32, rows sum to 1; zero for vertices without faces.
    """
    used = np.unique(faces)
    tree = KDTree(np.hstack([body, _TURN_M * vertex_normals(body, body_faces)]))
    normals = vertex_normals(garment, faces)[used]
    distance, near = tree.query(np.hstack([garment[used], _TURN_M * normals]), k=_NEAREST)
    share = 1 / np.maximum(distance, _SMALL_M)
    share /= share.sum(axis=1, keepdims=True)
    out = np.zeros((len(garment), weights.shape[1]))
    out[used] = np.einsum("vk,vkj->vj", share, weights[near])
    out = blur(out, averaging_matrix(faces, len(garment)), _PASSES)
    out[used] /= out[used].sum(axis=1, keepdims=True)
    return out.astype(np.float32)


def interpolated_weights(
    garment: np.ndarray,
    faces: np.ndarray,
    body: np.ndarray,
    weights: np.ndarray,
    neighbours: int = 256,
    passes: int = 100,
    step: float = 0.1,
    power: Literal[1, 2] = 1,
    coincident: Literal["vertex", "released"] = "vertex",
) -> np.ndarray:
    """Equation 2 of Garment4D: W_g = W_g^K I_w, then Laplacian smoothing over the garment.

    Args:
        garment: (N, 3) metres, in the pose and frame of `body`.
        faces: (F, 3) or (F, 4) of the garment.
        body: (V, 3) metres.
        weights: (V, 24) of the body, rows sum to 1.
        neighbours: K body vertices that each garment vertex takes after; at most V.
        passes: of uniform Laplacian smoothing.
        step: share of the way to the neighbours' mean that a pass goes.
        power: of the inverse distance; the released code has 2.
        coincident: what a garment vertex on a body vertex takes: "vertex", that one's weights
            alone; "released", those of all its other neighbours, as the released code does.

    Returns:
        (N, 24) float32, rows sum to 1.
    """
    count = min(neighbours, len(body))
    squared, near = nearest_points(body, garment, count)
    distance = np.sqrt(squared)
    on = distance < _COINCIDENT_M
    share = 1 / (distance + _SMALL_M) ** power
    if coincident == "vertex":
        share[on.any(axis=1)] = 0
        share[on] = 1
    else:
        share[on & ~on.all(axis=1, keepdims=True)] = 0
    share /= share.sum(axis=1, keepdims=True)
    rows = np.arange(len(garment) + 1) * count
    # As one sparse product, which spares the (N, K, 24) array of gathered weights.
    blend = sp.csr_matrix((share.ravel(), near.ravel(), rows), shape=(len(garment), len(body)))
    out = blend @ np.asarray(weights, dtype=np.float64)
    smooth = _smoothing_step(faces, len(garment), step)
    for _ in range(passes):
        out = smooth @ out
    return out.astype(np.float32)


def _smoothing_step(faces: np.ndarray, count: int, step: float) -> sp.csr_matrix:
    """(N, N) matrix that moves every vertex a step of the way to the mean of its neighbours."""
    average = averaging_matrix(faces, count)
    has_neighbours = sp.diags((np.diff(average.indptr) > 0).astype(np.float64))
    return (sp.identity(count) + step * (average - has_neighbours)).tocsr()
