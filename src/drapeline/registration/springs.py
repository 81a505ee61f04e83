"""Springs that hold a mesh together: along its edges, and across them against bending."""

import numpy as np

from drapeline.geometry.mesh import edges


def springs(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertex pairs (K, 2): all edges, then corners that face one another; (K,) bool the latter."""
    along, across = edges(faces), pairs_across(faces)
    return np.concatenate([along, across]), np.arange(len(along) + len(across)) >= len(along)


def spring_lengths(vertices: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(..., K) distances of pairs (K, 2) of vertices (..., N, 3)."""
    away = vertices[..., pairs[:, 0], :] - vertices[..., pairs[:, 1], :]
    return np.linalg.norm(away, axis=-1)


def pairs_across(faces: np.ndarray) -> np.ndarray:
    """(K, 2) corners that face one another across an inner edge."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    apex = np.roll(faces, 1, axis=1).ravel()
    half = np.sort(half, axis=1)
    order = np.lexsort((half[:, 1], half[:, 0]))
    half, apex = half[order], apex[order]
    twin = (half[1:] == half[:-1]).all(axis=1)
    return np.stack([apex[:-1][twin], apex[1:][twin]], axis=1)
