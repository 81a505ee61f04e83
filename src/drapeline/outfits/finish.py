"""Seams, hems, bands, buttons and pockets of a garment, drawn on the picture of its cloth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.mesh import boundary_loops
from drapeline.outfits.outfit import Garment
from drapeline.outfits.prints import TEXTURE_PX, draw_print, metres_per_unit
from drapeline.seeding import rng_for

# Metres from the edge.
_HEM_M, _LEG_HEM_M, _EDGE_STITCH_M = 0.02, 0.025, 0.005
_RIB_M, _BINDING_M, _CUFF_M, _WAISTBAND_M, _PLACKET_M = 0.016, 0.008, 0.055, 0.035, 0.03
_TOPSTITCH_M = (0.004, 0.009)
_SEAM_M, _STITCH_M = 0.0022, 0.0014  # widths of lines
_BUTTON_M, _SMALL_BUTTON_M = 0.0085, 0.0055  # radii
_BUTTONS_APART_M, _POLO_BUTTONS_APART_M = 0.08, 0.045
_LONG_SLEEVE = 0.85
_MIDDLE_M = 0.025  # from the plane of symmetry, within which fronts meet
_SOFT = ("jersey", "fleece")  # fabrics without fly and pockets
_TOPSTITCHED = ("denim",)
_ORANGE = (0.8, 0.58, 0.3)
_IVORY, _DARK = (0.92, 0.89, 0.82), (0.16, 0.14, 0.13)
_BACK_POCKET_M, _CHEST_POCKET_M = (0.135, 0.145), (0.1, 0.115)  # width and height
_NEAR_M = 0.03  # in height
_CHEST_POCKET_CHANCE = 0.5


def draw_cloth(garment: Garment, size: int = TEXTURE_PX) -> np.ndarray:
    """(size, size, 3) uint8 sRGB of a garment's texture map: its print, and how it is made up.

    Args:
        garment: at rest, with a "pattern" for a texture and the numbers that it was cut by.
        size: pixels.
    """
    about = garment.attributes["texture"]
    side_m = metres_per_unit(garment.vertices, garment.faces, garment.uv, garment.uv_faces)
    picture = draw_print(about["print"], side_m, size)
    map_ = _Map.of(garment)
    pen = _Pen(picture, garment, map_, size / side_m)
    parts = garment.attributes.get("parameters", {})
    _draw_seams(pen, map_)
    if "upper" in parts:
        _finish_upper(pen, map_, parts["upper"], parts["fold_seed"])
    if "trousers" in parts and "upper" not in parts:
        _finish_trousers(pen, map_)
    if "skirt" in parts and "upper" not in parts:
        pen.band(map_.top, _WAISTBAND_M)
    pen.stitch(map_.hem, _HEM_M)
    pen.stitch(map_.legs, _LEG_HEM_M)
    return picture


@dataclass(frozen=True)
class _Map:
    """Where the edges of a garment's panels lie in its texture map; (n, 2) rows of `uv` each."""

    panel: np.ndarray  # (T,) of each row of `uv`
    corner: np.ndarray  # (T,) vertex of each row
    seams: np.ndarray  # between panels, but for the middle of the front
    front: np.ndarray  # where the two fronts meet, sewn or not
    top: np.ndarray  # the open edge of the neck, the collar or the waist
    hem: np.ndarray  # that of the lower end, but for trousers
    sleeves: np.ndarray
    legs: np.ndarray

    @property
    def leg_panels(self) -> np.ndarray:
        """Numbers of the panels that end at a leg's hem."""
        return np.unique(self.panel[self.legs])

    @classmethod
    def of(cls, garment: Garment) -> "_Map":
        uv_faces, faces, points = garment.uv_faces, garment.faces, garment.vertices
        count = len(garment.uv)
        corner = np.zeros(count, dtype=np.int64)
        corner[uv_faces.ravel()] = faces.ravel()
        half = np.stack([uv_faces, np.roll(uv_faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        graph = coo_matrix((np.ones(len(half)), half.T), shape=(count, count))
        _, panel = connected_components(graph, directed=False)
        _, first, uses = np.unique(
            np.sort(half, axis=1), axis=0, return_index=True, return_counts=True
        )
        rims = half[first[uses == 1]]  # edges of panels
        ends = np.sort(corner[rims], axis=1)
        _, which, sewn = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        is_open = sewn[which] == 1
        place = points[ends]
        front = (np.abs(place[..., 0]) < _MIDDLE_M).all(axis=1) & (place[..., 1].mean(1) < 0)
        way = np.abs(place[:, 1] - place[:, 0])
        front &= way[:, 2] > 0.7 * np.linalg.norm(way, axis=1)
        kind = np.full(len(points), "hem", dtype="<U7")
        middle = (points[:, 2].max() + points[:, 2].min()) / 2
        for loop in boundary_loops(faces):
            x, z = points[loop, 0], points[loop, 2]
            if x.min() < 0 < x.max():
                kind[loop] = np.where(z > middle, "top", "hem")
            else:
                kind[loop] = "sleeves" if z.mean() > 0 else "legs"
        kinds = kind[ends[:, 0]]
        chosen = {
            name: rims[is_open & ~front & (kinds == name)]
            for name in ("top", "hem", "sleeves", "legs")
        }
        return cls(panel, corner, rims[~is_open & ~front], rims[front], **chosen)


class _Pen:
    """Draws in metres, panel by panel."""

    def __init__(
        self, picture: np.ndarray, garment: Garment, map_: _Map, pixels_per_m: float
    ) -> None:
        self._picture, self._scale, self._map = picture, pixels_per_m, map_
        size = len(picture)
        self.points = garment.vertices[map_.corner]  # (T, 3) metres
        self._pixels = garment.uv * [size, -size] + [0, size]
        panels = Image.new("I", (size, size), -1)
        draw = ImageDraw.Draw(panels)
        for face in garment.uv_faces:
            draw.polygon(list(map(tuple, self._pixels[face])), fill=int(map_.panel[face[0]]))
        self._panels = np.asarray(panels)
        ground = np.array(garment.attributes["texture"]["data"])
        self.dark = bool(ground.mean() < 0.3)
        self._line = 0.55 * ground + 0.3 if self.dark else 0.62 * ground
        topstitched = garment.attributes["fabric"] in _TOPSTITCHED
        self.topstitched, self.soft = topstitched, garment.attributes["fabric"] in _SOFT
        self._thread = np.array(_ORANGE) if topstitched else self._line

    def seam(self, edges: np.ndarray) -> None:
        """The shadow along edges of panels."""
        self._ink(edges, 0.0, _SEAM_M, self._line, 0.75)

    def stitch(self, edges: np.ndarray, *away_m: float) -> None:
        """Lines of thread that run along edges."""
        for distance in away_m:
            self._ink(edges, distance, _STITCH_M, self._thread, 0.9)

    def band(self, edges: np.ndarray, height_m: float) -> None:
        """A band along edges, in a slightly other tone, with a seam where it is set on."""
        self._ink(edges, 0.0, height_m, np.full(3, float(self.dark)), 0.09)
        self._ink(edges, height_m, _SEAM_M, self._line, 0.75)

    def path(self, row: int, *steps_m: Sequence[float]) -> None:
        """Thread by steps to the right and up; the first leads there from a row of `uv`."""
        corners = np.cumsum(steps_m, axis=0) * [self._scale, -self._scale] + self._pixels[row]
        self._fill(int(self._map.panel[row]), [corners], _STITCH_M, self._thread, 0.9)

    def buttons(
        self, rows: np.ndarray, levels_m: np.ndarray, away_m: float, radius_m: float
    ) -> None:
        """Buttons at heights, to the right of a line of rows of `uv` (n,) that runs upwards."""
        heights = self.points[rows, 2]
        rows = rows[np.argsort(heights)]
        colour = np.array(_IVORY if self.dark else _DARK)
        for level in levels_m:
            centre = np.array(
                [[np.interp(level, np.sort(heights), self._pixels[rows, k]) for k in (0, 1)]]
            )
            centre[0, 0] += away_m * self._scale
            for share, tone in ((1.0, 0.6 * colour), (0.85, colour)):
                width = 2 * share * radius_m
                self._fill(int(self._map.panel[rows[0]]), [centre], width, tone, 1.0)

    def nearest(self, target: Sequence[float], *, front: bool) -> int:
        """The row of `uv` that is nearest to a place at rest, on the front or on the back."""
        away = np.linalg.norm((self.points - target) * [1, 0.2, 1], axis=1)
        away[(self.points[:, 1] < np.median(self.points[:, 1])) != front] = np.inf
        return int(np.argmin(away))

    def side(self, row: int) -> float:
        """1 where the right of a panel in the map is nearer to the body's side there, else -1."""
        rows = np.flatnonzero(self._map.panel == self._map.panel[row])
        near = rows[np.abs(self.points[rows, 2] - self.points[row, 2]) < _NEAR_M]
        slope = np.cov(self._pixels[near, 0], np.abs(self.points[near, 0]))[0, 1]
        return 1.0 if slope > 0 else -1.0

    def _ink(
        self, edges: np.ndarray, away_m: float, width_m: float, colour: np.ndarray, share: float
    ) -> None:
        """Colour what lies from `away_m` on over a width within the edges."""
        for panel in np.unique(self._map.panel[edges[:, 0]]) if len(edges) else ():
            own = [self._pixels[edge] for edge in edges if self._map.panel[edge[0]] == panel]
            self._fill(int(panel), own, 2 * (away_m + width_m), colour, share, 2 * away_m)

    def _fill(
        self,
        panel: int,
        lines: Sequence[np.ndarray],
        width_m: float,
        colour: np.ndarray,
        share: float,
        inner_m: float = 0.0,
    ) -> None:
        """Blend a colour into a panel where lines (P, 2) of a width are, without an inner width."""
        reach = width_m * self._scale / 2 + 2
        ends = np.concatenate(lines)
        low = np.clip(np.floor(ends.min(axis=0) - reach).astype(int), 0, len(self._picture))
        high = np.clip(np.ceil(ends.max(axis=0) + reach).astype(int), 0, len(self._picture))
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        mask = self._stroke(lines, width_m, low, high)
        if inner_m > 0:
            mask = mask & ~self._stroke(lines, inner_m, low, high)
        mask = mask & (self._panels[window] == panel)
        part = self._picture[window]
        part[mask] = np.round((1 - share) * part[mask] + share * 255 * np.clip(colour, 0, 1))

    def _stroke(
        self, lines: Sequence[np.ndarray], width_m: float, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        """Pixels of a window (H, W) bool that are on lines with round ends."""
        mask = Image.new("1", tuple(np.maximum(high - low, 1).tolist()))
        draw = ImageDraw.Draw(mask)
        width = max(1.0, width_m * self._scale)
        for line in lines:
            local = [tuple(corner) for corner in (line - low).tolist()]
            if len(local) > 1:
                draw.line(local, fill=1, width=round(width))
            if width > 2:
                for x, y in local:
                    r = width / 2
                    draw.ellipse((x - r, y - r, x + r, y + r), fill=1)
        return np.asarray(mask)[: high[1] - low[1], : high[0] - low[0]]


def _draw_seams(pen: _Pen, map_: _Map) -> None:
    pen.seam(map_.seams)
    pen.seam(map_.front[np.isin(map_.panel[map_.front[:, 0]], map_.leg_panels)])
    if pen.topstitched:
        pen.stitch(map_.seams, *_TOPSTITCH_M)


def _finish_upper(pen: _Pen, map_: _Map, numbers: Mapping[str, Any], seed: int) -> None:
    shirt = numbers["front"] != "closed"
    if shirt:
        pen.stitch(map_.top, _EDGE_STITCH_M)  # of the collar
        _draw_placket(pen, map_, numbers)
    else:
        pen.band(map_.top, _RIB_M if "sleeve_length" in numbers else _BINDING_M)
    if shirt and numbers.get("sleeve_length", 0) > _LONG_SLEEVE:
        pen.band(map_.sleeves, _CUFF_M)
        pen.stitch(map_.sleeves, _EDGE_STITCH_M)
    else:
        pen.stitch(map_.sleeves, _HEM_M)
    woven_shirt = numbers["front"] == "buttoned" and not pen.soft
    if woven_shirt and rng_for(seed, "pocket").random() < _CHEST_POCKET_CHANCE:
        _draw_chest_pocket(pen, map_)


def _draw_placket(pen: _Pen, map_: _Map, numbers: Mapping[str, Any]) -> None:
    """Stitches beside the middle of the front, and buttons between, on the wearer's left panel."""
    edges = _of_left(pen, map_)
    if not len(edges):
        return
    pen.stitch(edges, _PLACKET_M)
    rows = np.unique(edges)
    high, low = pen.points[rows, 2].max(), pen.points[rows, 2].min() + 0.04
    apart = _BUTTONS_APART_M
    if numbers["front"] == "polo":
        low, apart = high - numbers["placket_m"], _POLO_BUTTONS_APART_M
    levels = np.arange(high - 0.012, low, -apart)
    pen.buttons(rows, levels, _PLACKET_M / 2, _SMALL_BUTTON_M)


def _of_left(pen: _Pen, map_: _Map, *, legs: bool = False) -> np.ndarray:
    """(n, 2) edges in the middle of the front that are of the wearer's left panel.

    Args:
        legs: whether of a leg's panel, or else of the trunk's.
    """
    panel = map_.panel[map_.front[:, 0]]
    left = [
        number
        for number in np.unique(panel)
        if pen.points[map_.panel == number, 0].mean() > 0 and (number in map_.leg_panels) == legs
    ]
    # A collar's ends are higher.
    lowest = {number: pen.points[map_.front[panel == number], 2].min() for number in left}
    return map_.front[panel == min(left, key=lowest.__getitem__)] if left else map_.front[:0]


def _draw_chest_pocket(pen: _Pen, map_: _Map) -> None:
    top = pen.points[np.ravel(map_.front), 2].max()
    row = pen.nearest((0.045, -0.1, top - 0.12), front=True)
    wide, high = _CHEST_POCKET_M
    pen.path(row, *_pocket(0.0, 0.0, wide, high))
    pen.path(row, (0, -0.02), (wide, 0))


def _pocket(left: float, top: float, wide: float, high: float) -> list[tuple[float, float]]:
    """Steps around a patch pocket from its upper left corner."""
    down, low, half = 0.8 * high, 0.2 * high, wide / 2
    return [(left, top), (0, -down), (half, -low), (half, low), (0, down), (-wide, 0)]


def _finish_trousers(pen: _Pen, map_: _Map) -> None:
    pen.band(map_.top, _WAISTBAND_M)
    if pen.soft:
        return
    pen.stitch(map_.top, _EDGE_STITCH_M)
    waist = pen.points[np.ravel(map_.top)]
    level, half = float(waist[:, 2].mean()), float(np.abs(waist[:, 0]).max())
    edges = _of_left(pen, map_, legs=True)
    if len(edges):
        rows = np.unique(edges)
        top = int(rows[np.argmax(pen.points[rows, 2])])
        out = pen.side(top)
        turn = np.linspace(0, np.pi / 2, 9)
        curve = 0.035 * np.stack([out * np.cos(turn), -np.sin(turn)], axis=1)
        steps = np.diff(curve, axis=0).tolist()
        pen.path(top, (0.035 * out, -_WAISTBAND_M), (0, -0.09), *steps)
        pen.buttons(rows, np.array([level - _WAISTBAND_M / 2]), 0.012 * out, _BUTTON_M)
    wide, high = _BACK_POCKET_M
    for sign in (1.0, -1.0):
        row = pen.nearest((0.55 * sign * half, -0.1, level), front=True)
        out = pen.side(row)
        pen.path(row, (0, -_WAISTBAND_M), (0.03 * out, -0.11), (0.14 * out, -0.05))
        row = pen.nearest((0.5 * sign * half, 0.1, level), front=False)
        pen.path(row, *_pocket(-wide / 2, -0.075, wide, high))
