"""The body that skirts are laid on: both legs in one smooth tube with evenly spread vertices.

Smoothing the inner legs, as the paper does, leaves a handful of vertices to span the gap between
the calves, up to 20 cm apart from one another, while the outer sides keep theirs a centimetre
apart. But a skirt is as wide in front as at its sides. So the tube is built anew: at each height
it is the convex hull of both legs, and the vertices of the second topology stand around it at
shares of its length that are computed once, by a harmonic map between its upper end and its hem.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import ConvexHull

from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import boundary_loops, edge_graph, edges
from drapeline.registration.to_body.topology import Topology

_LEVEL_M = 0.02
_AROUND = 128
_SLOPE_LEVELS = 4
_BLEND_M = 0.06  # over this height the body turns into the tube


class SkirtTube:
    """Places of the legs' vertices on the tube.

    Args:
        topology: of the super-resolved body; its vertices are spread over the mean body's tube.

    Attributes:
        moved: (M,) ids of the vertices that stand on the tube, all below the hips.
        share: (M,) in [0, 1), part of the way around from the front's middle.
        height: (M,) 0 at the hem to 1 at the hips.
    """

    def __init__(self, topology: Topology) -> None:
        rest = np.asarray(topology.rest, dtype=np.float64)
        faces = topology.skirt_faces
        inner_leg = np.flatnonzero(topology.inner_leg)
        self._top = int(inner_leg[rest[inner_leg, 2].argmax()])
        self._hem = min(boundary_loops(faces), key=lambda loop: rest[loop, 2].mean())
        self._low = np.flatnonzero(rest[:, 2] < rest[self._top, 2] + _BLEND_M)
        self.moved = np.flatnonzero(rest[:, 2] < rest[self._top, 2])
        hem, top = self._levels(rest)
        height = (rest[:, 2] - hem) / (top - hem)
        share = _share(_sections(rest[self._low]), rest)
        height[self._hem], share[self._hem] = 0, _even_steps(share[self._hem])
        spread = _Harmonic(faces, np.setdiff1d(self.moved, self._hem), len(rest))
        height = spread(height)
        turn = np.exp(2j * np.pi * share)
        guess = np.angle(spread(turn.real) + 1j * spread(turn.imag)) / (2 * np.pi)
        self.share = spread(guess, periodic=True)[self.moved] % 1
        self.height = height[self.moved]

    def __call__(self, vertices: np.ndarray, skirt: np.ndarray, boundary: np.ndarray) -> np.ndarray:
        """(V, 3) float64 metres of a body whose legs are put in one tube as wide as a skirt.

        Args:
            vertices: (V, 3) body of any shape in the rest pose.
            skirt: (C, 3) vertices of the garment.
            boundary: ids of those along its openings.
        """
        out = np.array(vertices, dtype=np.float64)
        hem, top = self._levels(out)
        height = hem + self.height * (top - hem)
        hanging = skirt[boundary, 2][skirt[boundary, 2] < top]
        end = hanging.max() if len(hanging) else top
        cloth = skirt[(skirt[:, 2] < top + _BLEND_M) & (skirt[:, 2] > hem)]
        sections = _sections(np.concatenate([out[self._low], cloth]))
        place = np.column_stack(
            [_places(_continue_below(sections, end), height, self.share), height]
        )
        blend = np.clip((1 - self.height) * (top - hem) / _BLEND_M, 0, 1)
        blend = (blend * blend * (3 - 2 * blend))[:, None]
        out[self.moved] = (1 - blend) * out[self.moved] + blend * place
        return out

    def _levels(self, vertices: np.ndarray) -> tuple[float, float]:
        """Heights of the hem and of the tube's upper end."""
        return float(vertices[self._hem, 2].mean()), float(vertices[self._top, 2])


def _sections(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hulls around points (P, 3) at even heights.

    Returns:
        Heights (L,) and outlines (L, K, 2), each in equal steps from the front's middle on,
        counter-clockwise seen from above.
    """
    low, high = points[:, 2].min(), points[:, 2].max()
    heights = np.linspace(low, high, max(3, round((high - low) / _LEVEL_M)))
    outlines = np.zeros((len(heights), _AROUND, 2))
    order = points[np.argsort(points[:, 2])]
    first = np.searchsorted(order[:, 2], heights - _LEVEL_M)
    last = np.searchsorted(order[:, 2], heights + _LEVEL_M)
    for outline, start, stop in zip(outlines, first, last, strict=True):
        flat = order[start:stop, :2]
        outline[:] = _outline(flat[ConvexHull(flat).vertices])
    return heights, outlines


def _continue_below(
    sections: tuple[np.ndarray, np.ndarray], end: float
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolate the sections below the height `end` from how the skirt widens above it."""
    heights, outlines = sections
    whole = int(np.searchsorted(heights, end + _LEVEL_M))
    if not 0 < whole < len(heights) - _SLOPE_LEVELS:
        return sections
    slope = (outlines[whole] - outlines[whole + _SLOPE_LEVELS]) / _SLOPE_LEVELS
    steps = np.arange(whole, 0, -1)[:, None, None]
    outlines = np.concatenate([outlines[whole] + steps * slope, outlines[whole:]])
    return heights, outlines


def _outline(corners: np.ndarray) -> np.ndarray:
    """(K, 2) equal steps along a convex polygon (C, 2), counter-clockwise, from its front on."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    # Angle from the front (-Y), increasing counter-clockwise.
    angle = np.arctan2(corners[:, 0] - middle[0], middle[1] - corners[:, 1]) % (2 * np.pi)
    corners = corners[np.argsort(angle)]
    before, after = corners[-1], corners[0]
    share = (middle[0] - before[0]) / (after[0] - before[0])
    front = (before + share * (after - before))[None]
    ring = np.concatenate([front, corners, front])
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    steps = np.linspace(0, way[-1], _AROUND, endpoint=False)
    return np.stack([np.interp(steps, way, ring[:, axis]) for axis in (0, 1)], axis=1)


def _places(
    sections: tuple[np.ndarray, np.ndarray], height: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """(M, 2) points of the tube at heights (M,) and shares (M,) of the way around."""
    heights, outlines = sections
    row = (height - heights[0]) / (heights[1] - heights[0])
    row = np.clip(row, 0, len(heights) - 1 - 1e-9)
    column = share * _AROUND
    i, j = row.astype(int), column.astype(int) % _AROUND
    u, v = (row - i)[:, None], (column - np.floor(column))[:, None]
    after = (j + 1) % _AROUND
    lower = (1 - v) * outlines[i, j] + v * outlines[i, after]
    return (1 - u) * lower + u * ((1 - v) * outlines[i + 1, j] + v * outlines[i + 1, after])


def _share(sections: tuple[np.ndarray, np.ndarray], points: np.ndarray) -> np.ndarray:
    """(P,) share of the way around at which the tube passes closest to each point."""
    heights, outlines = sections
    level = np.abs(points[:, 2, None] - heights).argmin(axis=1)
    gap = ((outlines[level] - points[:, None, :2]) ** 2).sum(-1)
    return gap.argmin(axis=1) / _AROUND


def _even_steps(share: np.ndarray) -> np.ndarray:
    """Even steps around, in the direction and with the start that fit shares (n,) best."""
    steps = np.arange(len(share)) / len(share)
    turn = np.exp(2j * np.pi * share)
    fits = [(turn * np.exp(-2j * np.pi * s)).sum() for s in (steps, -steps)]
    sign = 1 if abs(fits[0]) > abs(fits[1]) else -1
    return (sign * steps + np.angle(max(fits, key=abs)) / (2 * np.pi)) % 1


class _Harmonic:
    """Harmonic values: those of free vertices are their neighbours' means, others are given.

    Args:
        faces: (F, 3).
        free: ids of the free vertices.
        count: V, number of vertices.
    """

    def __init__(self, faces: np.ndarray, free: np.ndarray, count: int) -> None:
        graph = edge_graph(edges(faces), count)
        self._free, self._rows = free, graph[free].tocoo()
        self._given = graph[free].copy()
        is_free = np.zeros(count, dtype=bool)
        is_free[free] = True
        self._is_free = is_free
        degree = np.asarray(graph[free].sum(axis=1)).ravel()
        self._solve = symmetric_factor(sp.diags(degree) - graph[free][:, free]).solve

    def __call__(self, values: np.ndarray, *, periodic: bool = False) -> np.ndarray:
        """Solve for values (V,); `periodic` ones have period 1 and must be close already."""
        pull = self._given @ np.where(self._is_free, 0, values)
        if periodic:
            row, column = self._rows.row, self._rows.col
            laps = np.round(values[self._free[row]] - values[column])
            pull += np.bincount(row, laps, len(self._free))
        out = values.copy()
        out[self._free] = self._solve(pull)
        return out
