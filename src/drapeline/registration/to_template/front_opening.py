"""Shirts that open in front, closed by a strip of faces so that they have the usual openings."""

import numpy as np

from drapeline.geometry.mesh import boundary_loops

_FRONT_M = 0.04  # wider gaps are not a front that has come open a little
# Along the boundary, two vertices on the sides of a gap are at least this far apart ...
_APART_M = 0.045
_APART_TIMES = 3.0  # ... and so many times further than across it
_ONWARD = 0.8  # cosine at which a boundary runs away from the other side: the front has ended


def front_strip(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Faces (n, 3) that close the front of a shirt, none where it is closed.

    Args:
        vertices: (V, 3) metres, root frame, in `REST_POSE`.
        triangles: (F, 3) of an open shirt, a polo or a closed one.

    Returns:
        Triangles between the two sides of the opening, turned as their neighbours are.
    """
    loops = boundary_loops(triangles)
    # Cuffs lie furthest to the sides, and tight ones must not be sewn up.
    aside = sorted(loops, key=lambda loop: abs(vertices[loop, 0].mean()))
    cuffs = 2 if len(loops) > 2 else 0
    strips = [_strip(vertices, loop) for loop in aside[: len(loops) - cuffs]]
    return np.concatenate(strips).astype(triangles.dtype)


def _strip(vertices: np.ndarray, loop: np.ndarray) -> np.ndarray:
    points = vertices[loop]
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)[:-1]])
    along = np.abs(at[:, None] - at)
    along = np.minimum(along, step.sum() - along)
    across = np.linalg.norm(points[:, None] - points, axis=-1)
    gap = (along > _APART_M) & (along > _APART_TIMES * across)
    across = np.where(gap, across, np.inf)
    start = np.unravel_index(across.argmin(), across.shape)
    if across[start] > _FRONT_M:
        return np.zeros((0, 3), dtype=np.int64)
    first, second = sorted(start)
    count = len(loop)
    # From the narrowest place the strip runs both ways along the boundary.
    inner = _zip_arc(points, np.arange(first, second + 1))
    outer = _zip_arc(points, np.arange(second, first + count + 1) % count)
    return loop[np.array(inner + outer, dtype=np.int64).reshape(-1, 3)]


def _zip_arc(points: np.ndarray, arc: np.ndarray) -> list[tuple[int, int, int]]:
    """Triangles over a part of the boundary (n,), from its ends inwards while they stay close."""
    made = []
    low, high = 0, len(arc) - 1
    while high - low > 1:
        ways = []
        for at, after, other in ((low, low + 1, high), (high, high - 1, low)):
            p, q, r = points[arc[at]], points[arc[after]], points[arc[other]]
            ahead, from_other = q - p, p - r
            far, step = np.linalg.norm(q - r), np.linalg.norm(ahead)
            turn = ahead @ from_other
            size = step * np.linalg.norm(from_other)
            if far < np.hypot(_FRONT_M, step) and turn < _ONWARD * size:
                ways.append((far, after))
        if not ways:
            break
        after = min(ways)[1]
        # Against the direction of the boundary, along which the cloth lies to the left.
        made.append((arc[high], arc[after], arc[low]))
        low, high = (after, high) if after == low + 1 else (low, after)
    return made
