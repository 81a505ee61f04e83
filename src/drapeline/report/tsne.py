"""t-SNE (van der Maaten and Hinton 2008) for a few thousand points, exact and without chance."""

import numpy as np
from scipy.spatial.distance import pdist, squareform

POINTS_MAX = 2500
_EXAGGERATION = 12.0
_EARLY = 250


def tsne(points: np.ndarray, *, perplexity: float = 30.0, steps: int = 750) -> np.ndarray:
    """Lay points out in the plane so that neighbours stay neighbours.

    Starts from the first two principal components, so equal points give equal layouts.

    Args:
        points: (N, D), at most `POINTS_MAX` of them: time and memory grow with their square.
        perplexity: neighbours that each point sees, at most a third of all.
        steps: of gradient descent with momentum.

    Returns:
        (N, 2) float64, centred.
    """
    count = len(points)
    if count > POINTS_MAX:
        raise ValueError(f"{count} points, expected at most {POINTS_MAX}")
    if count < 4:
        return np.stack([np.arange(count), np.zeros(count)], axis=1)
    near = _affinities(points, min(perplexity, (count - 1) / 3))
    near = np.maximum((near + near.T) / (2 * count), 1e-12).astype(np.float32)
    centred = points - points.mean(axis=0)
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    place = np.zeros((count, 2))
    place[:, : min(2, u.shape[1])] = (u * s)[:, :2]
    place = (place * 1e-4 / max(place[:, 0].std(), 1e-12)).astype(np.float32)
    rate = max(count / _EXAGGERATION / 4, 50.0)
    gain, speed = np.ones_like(place), np.zeros_like(place)
    for step in range(steps):
        weight = near * np.float32(_EXAGGERATION if step < _EARLY else 1.0)
        gradient = _gradient(weight, place)
        gain = np.where(gradient * speed < 0, gain + 0.2, np.maximum(gain * 0.8, 0.01))
        speed = (0.5 if step < _EARLY else 0.8) * speed - rate * gain * gradient
        place = (place + speed).astype(np.float32)
        place -= place.mean(axis=0)
    return place.astype(np.float64)


def _affinities(points: np.ndarray, perplexity: float) -> np.ndarray:
    """(N, N) chance that i picks j as a neighbour; each row's width gives the perplexity."""
    squared = squareform(pdist(points, "sqeuclidean"))
    np.fill_diagonal(squared, np.inf)
    squared -= squared.min(axis=1, keepdims=True)  # the chances stay, and none underflow
    low = np.zeros((len(points), 1))
    high = np.full((len(points), 1), np.inf)
    beta = np.full((len(points), 1), 1 / max(squared[np.isfinite(squared)].mean(), 1e-30))
    for _ in range(60):
        weight = np.exp(-squared * beta)
        chance = weight / weight.sum(axis=1, keepdims=True)
        entropy = -(chance * np.log(np.maximum(chance, 1e-300))).sum(axis=1, keepdims=True)
        wide = entropy > np.log(perplexity)
        low, high = np.where(wide, beta, low), np.where(wide, high, beta)
        beta = np.where(np.isinf(high), 2 * beta, (low + np.minimum(high, 1e300)) / 2)
    return chance


def _gradient(near: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Of the divergence between neighbourhoods above (N, N) and in the plane (N, 2)."""
    square = (place**2).sum(axis=1)
    kernel = square[:, None] + square - 2 * place @ place.T
    kernel = 1 / (1 + np.maximum(kernel, 0))
    np.fill_diagonal(kernel, 0)
    force = (near - kernel / kernel.sum()) * kernel
    return 4 * (force.sum(axis=1)[:, None] * place - force @ place)
