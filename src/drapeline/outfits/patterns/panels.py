"""Garments as sewing patterns: quad panels on grids that share the vertices of their seams."""

from dataclasses import dataclass, field

import numpy as np

from drapeline.geometry.smoothing import Constraint

_UV_MARGIN_M = 0.03


@dataclass
class Pattern:
    """A garment under construction.

    Attributes:
        blocks: vertex positions (n, 3) added so far, in order.
        panels: grids of vertex ids (R, C), -1 where a panel is cut out; columns run
            counter-clockwise around the body or limb and rows towards the head or the torso, so
            that faces look outwards. Each comes with the column that is laid straight in the UV.
        marks: named rows of vertex ids ("hem", "neck", "left_cuff", ...).
    """

    blocks: list[np.ndarray] = field(default_factory=list)
    panels: list[tuple[np.ndarray, int]] = field(default_factory=list)
    marks: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of vertices so far."""
        return sum(len(block) for block in self.blocks)

    @property
    def vertices(self) -> np.ndarray:
        """(V, 3) float64 positions."""
        return np.concatenate(self.blocks)

    @vertices.setter
    def vertices(self, points: np.ndarray) -> None:
        self.blocks = [points]

    def add_vertices(self, points: np.ndarray) -> np.ndarray:
        """Add positions (..., 3); returns their ids (...)."""
        start = self.count
        self.blocks.append(np.asarray(points, dtype=np.float64).reshape(-1, 3))
        return np.arange(start, self.count).reshape(points.shape[:-1])

    def add_panel(self, ids: np.ndarray, straight: int) -> None:
        """Add a panel; a cell becomes a quad where all four corners exist."""
        self.panels.append((ids, straight))

    def faces(self) -> np.ndarray:
        """(F, 4) int32 vertex ids, counter-clockwise from outside."""
        return np.concatenate([_cells(ids) for ids, _ in self.panels]).astype(np.int32)

    def texture(self) -> tuple[np.ndarray, np.ndarray]:
        """Panels laid flat side by side: uv (T, 2) float32 in [0, 1] and uv_faces (F, 4) int32.

        Along a row distances are true; rows lie at the mean distance of their neighbours.
        """
        points = self.vertices
        flats, faces, start = [], [], 0
        for ids, straight in self.panels:
            flat = _flatten(points, ids, straight)
            used = ids >= 0
            number = np.full(ids.shape, -1)
            number[used] = start + np.arange(used.sum())
            flats.append(flat[used])
            faces.append(_cells(number))
            start += int(used.sum())
        return _pack(flats), np.concatenate(faces).astype(np.int32)


def _cells(ids: np.ndarray) -> np.ndarray:
    corners = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1)
    corners = corners.reshape(-1, 4)
    return corners[(corners >= 0).all(axis=1)]


def _flatten(points: np.ndarray, ids: np.ndarray, straight: int) -> np.ndarray:
    """(R, C, 2) metres; strictly increasing along rows and columns, hence without folds."""
    grid = points[ids]
    exists = ids >= 0
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    across_ok = exists[:, 1:] & exists[:, :-1]
    fill = across[across_ok].mean()
    across = np.where(across_ok, np.maximum(across, 1e-4), fill)
    u = np.concatenate([np.zeros((len(ids), 1)), np.cumsum(across, axis=1)], axis=1)
    u -= u[:, [straight]]
    along = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    along_ok = exists[1:] & exists[:-1]
    step = np.where(along_ok, along, 0).sum(axis=1) / np.maximum(along_ok.sum(axis=1), 1)
    v = np.cumsum([0.0, *np.maximum(step, 1e-4)])
    return np.stack([u, np.broadcast_to(v[:, None], u.shape)], axis=-1)


def _pack(flats: list[np.ndarray]) -> np.ndarray:
    """Shelves of panels, filled left to right, scaled into the unit square as a whole."""
    flats = [flat - flat.min(axis=0) for flat in flats]
    sizes = np.array([flat.max(axis=0) for flat in flats]) + _UV_MARGIN_M
    shelf_width = max(sizes[:, 0].max(), np.sqrt(sizes.prod(axis=1).sum() * 1.2))
    x = y = height = 0.0
    placed = []
    for flat, (width, tall) in zip(flats, sizes, strict=True):
        if x > 0 and x + width > shelf_width:
            x, y, height = 0.0, y + height, 0.0
        placed.append(flat + np.array([x, y]) + _UV_MARGIN_M / 2)
        x += width
        height = max(height, tall)
    uv = np.concatenate(placed)
    return (uv / max(shelf_width, y + height)).astype(np.float32)


BETWEEN_LEGS_M = 0.004  # half the distance between the two legs
BETWEEN_FRONTS_M = 0.004
_SIDES = (("left", 1.0), ("right", -1.0))


def separator(pattern: Pattern, between_legs_m: float = BETWEEN_LEGS_M) -> Constraint:
    """A function that puts vertices (V, 3) of a garment back on their own sides, in place.

    Half of the distance between two trouser legs is `between_legs_m`.
    """
    marks = pattern.marks
    legs = [(marks[f"{s}_leg"], sign) for s, sign in _SIDES if f"{s}_leg" in marks]
    right, left = np.split(marks.get("placket", np.zeros(0, dtype=int)), 2)

    def separate(points: np.ndarray) -> np.ndarray:
        for leg, sign in legs:
            points[leg, 0] = sign * np.maximum(sign * points[leg, 0], between_legs_m)
        lack = np.maximum(BETWEEN_FRONTS_M - (points[left, 0] - points[right, 0]), 0) / 2
        points[left, 0] += lack
        points[right, 0] -= lack
        return points

    return separate
