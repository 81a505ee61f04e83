"""Skinning weights for garments: those of the body beneath, smoothed."""

import numpy as np
from scipy.spatial import KDTree

from drapeline.mesh import vertex_normals
from drapeline.outfits.relax import averaging_matrix

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
