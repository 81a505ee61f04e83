"""Rays for tests of what they hit."""

import numpy as np


def rays_clear_of_edges(points, ways, triangles, least_m=1e-5):
    """Which rays (P,) keep so far from all edges that no rounding decides what they hit.

    Args:
        points: (P, 3), where they start.
        ways: (P, 3) or (3,), of any length.
        triangles: (F, 3, 3).
    """
    ways = np.broadcast_to(ways, points.shape)
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    clear = np.ones(len(points), dtype=bool)
    for k, (point, way) in enumerate(zip(points, ways, strict=True)):
        across = triangles - point
        across = across - (across @ way)[..., None] * way
        side = np.roll(across, -1, axis=1) - across
        square = np.maximum((side**2).sum(axis=2), 1e-30)  # 0 of an edge along the ray
        nearest = np.clip(-(across * side).sum(axis=2) / square, 0, 1)
        clear[k] = np.linalg.norm(across + nearest[..., None] * side, axis=2).min() > least_m
    return clear
