"""Interpolated skinning weights of Garment4D (equation 2): those of many body vertices around."""

from typing import Literal

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree, cKDTree

from drapeline.geometry.mesh import edge_graph, edges, vertex_normals
from drapeline.geometry.smoothing import averaging_matrix

# Added to distances in metres, so that a vertex a micrometre away is not all there is.
_SMALL_M = 1e-6
_COINCIDENT_M = 1e-9


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
    """Equation 2: W_g = W_g^K I_w, then Laplacian smoothing over the garment.

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
    distance, near = cKDTree(body).query(garment, k=count)
    distance, near = distance.reshape(-1, count), near.reshape(-1, count)
    on = distance < _COINCIDENT_M
    share = 1 / (distance + _SMALL_M) ** power
    if coincident == "vertex":
        share[on.any(axis=1)] = 0
        share[on] = 1
    else:
        share[on & ~on.all(axis=1, keepdims=True)] = 0
    share /= share.sum(axis=1, keepdims=True)
    rows = np.arange(len(garment) + 1) * count
    # One sparse product does not gather the (N, K, 24) weights first.
    blend = sp.csr_matrix((share.ravel(), near.ravel(), rows), shape=(len(garment), len(body)))
    out = blend @ np.asarray(weights, dtype=np.float64)
    smooth = _smoothing(faces, len(garment), step)
    for _ in range(passes):
        out = smooth @ out
    return out.astype(np.float32)


def _smoothing(faces: np.ndarray, count: int, step: float) -> sp.csr_matrix:
    """(N, N) one pass: every vertex goes a step of the way to the mean of its neighbours."""
    graph = edge_graph(edges(faces), count)
    degree = np.asarray(graph.sum(axis=1)).ravel()
    mean = sp.diags(1 / np.maximum(degree, 1)) @ graph
    joined = sp.diags((degree > 0).astype(np.float64))
    return (sp.identity(count) + step * (mean - joined)).tocsr()


_NEAREST = 8


_TURN_M = 0.1  # as in registration: a sleeve does not take after the torso beside it


_PASSES = 20


def garment_weights(
    garment: np.ndarray,
    faces: np.ndarray,
    body: np.ndarray,
    body_faces: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """Weights of the nearest body vertices that face the same way, then Laplacian smoothing.

    Args:
        garment: (V, 3) metres, in the body's rest pose; vertices without faces are passed over.
        faces: (F, 3) of the garment.
        body: (B, 3) in the rest pose.
        body_faces: (G, 3).
        weights: (B, K) of the body, rows sum to 1.

    Returns:
        (V, K) float32, rows sum to 1; zero where the garment has no faces.
    """
    used = np.unique(faces)
    tree = KDTree(np.hstack([body, _TURN_M * vertex_normals(body, body_faces)]))
    normals = vertex_normals(garment, faces)[used]
    distance, near = tree.query(np.hstack([garment[used], _TURN_M * normals]), k=_NEAREST)
    share = 1 / np.maximum(distance, 1e-6)
    share /= share.sum(axis=1, keepdims=True)
    out = np.zeros((len(garment), weights.shape[1]))
    out[used] = np.einsum("vk,vkj->vj", share, weights[near])
    mean = averaging_matrix(faces, len(garment))
    for _ in range(_PASSES):
        out = (out + mean @ out) / 2
    out[used] /= out[used].sum(axis=1, keepdims=True)
    return out.astype(np.float32)
