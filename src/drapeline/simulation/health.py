"""Is a simulated frame believable? Measures per frame and garment, and their bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import KDTree

from drapeline.frames import FPS
from drapeline.geometry.crossings import Crossings
from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.moving_surface import MovingSheet, MovingSurface
from drapeline.outfits.openings import WornOpenings
from drapeline.outfits.outfit import Garment
from drapeline.simulation.attachments import Carrier
from drapeline.simulation.settings import HealthBounds

_LAYER_REACH_M = 0.03
_FOLLOWED = 200
_NEAR_M = 0.04
# Where the body is no farther from itself, as in armpits, in the groin and in bent elbows and
# knees, or lies in itself, there may be no room for cloth.
_FOLD_M = 0.04


@dataclass(frozen=True)
class HealthGarment:
    """A garment as health sees it."""

    name: str
    faces: np.ndarray  # (F, 4) or (F, 3)
    rest_lengths_m: np.ndarray  # (E,) of `mesh.edges(faces)`; NaN for edges that are not watched
    openings: WornOpenings = field(default_factory=lambda: WornOpenings(()))


def watch(garment: Garment, joints: np.ndarray) -> HealthGarment:
    """A garment at rest on a body with joints (24, 3), in metres.

    Lengths of elastics, which are there to give, are not watched.
    """
    watched = watch_mesh(garment.name, garment.vertices, garment.faces, garment.elastic)
    openings = WornOpenings.at_rest(garment.vertices, garment.faces, joints)
    return replace(watched, openings=openings)


def watch_mesh(
    name: str, vertices: np.ndarray, faces: np.ndarray, elastic: np.ndarray | None = None
) -> HealthGarment:
    """A garment by its mesh at rest; without edges of no length.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 4) or (F, 3).
        elastic: (V,) above 0 where there is an elastic, whose edges are there to give.
    """
    pairs = edges(faces)
    ends = vertices[pairs]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    lengths[lengths == 0] = np.nan
    if elastic is not None:
        lengths[(elastic[pairs] > 0).any(axis=1)] = np.nan
    return HealthGarment(name, faces, lengths)


class HealthMonitor:
    """Measures frame after frame; keeps numbers only, and the last two frames."""

    def __init__(
        self,
        garments: Sequence[HealthGarment],
        body_faces: np.ndarray | None,
        *,
        fps: float = FPS,
    ) -> None:
        """Watch garments, from inner to outer, on a body with these faces (F, 3), if there is one.

        Args:
            fps: frames per second.
        """
        self._faces, self._fps = body_faces, fps
        self._surface: MovingSurface | None = None
        self._sheets: list[MovingSheet] = []
        self._crossings: Crossings | None = None
        self._faces_of = [g.faces for g in garments]
        self._triangles = [triangulate(g.faces) for g in garments]
        self._edges = [_watched_edges(g) for g in garments]
        self._openings = [g.openings for g in garments]
        self._rows: list[dict[str, list[float]]] = []
        self._past: list[Sequence[np.ndarray]] = []
        self._carried: list[tuple[np.ndarray, Carrier]] = []

    @property
    def frame_count(self) -> int:
        """Frames measured so far."""
        return len(self._rows)

    def add(
        self,
        cloths: Sequence[np.ndarray],
        body: np.ndarray | None,
        before: Sequence[np.ndarray] | None = None,
        joints: np.ndarray | None = None,
    ) -> dict[str, list[float]]:
        """Measure one frame: measure -> one value per garment.

        Without a body, none of contact; without joints, none of openings.

        Args:
            cloths: (V, 3) metres, root-relative, one per garment.
            body: (B, 3) in the same frame.
            before: `cloths` in the frame before the first, if the body stood still then.
            joints: (24, 3) in the same frame.
        """
        crossings = self._crossings_of(cloths)
        crossing, across = crossings.find(cloths)
        row: dict[str, list[float]] = {}
        sheets = self._inner_layers(cloths)
        contact = self._contact(cloths, body) if body is not None else [{} for _ in cloths]
        for g, cloth in enumerate(cloths):
            values = contact[g]
            values |= stretch(cloth, *self._edges[g])
            values["layer_share"] = max(
                (float(sheet.beneath(cloth, _LAYER_REACH_M).mean()) for sheet in sheets[:g]),
                default=0.0,
            )
            values["self_share"] = float(crossing[g] / crossings.edge_counts[g])
            values["self_crossings"] = float(crossing[g])
            values["layer_crossings"] = float(across[g])
            if joints is not None:
                values["lost_openings"] = float(len(self._openings[g].lost(cloth, joints)))
            values["acceleration_m_s2"] = values["settling_m_s"] = np.nan
            if before is not None:
                ways = np.linalg.norm(cloth - before[g], axis=1)
                values["settling_m_s"] = float(ways.mean() * self._fps)
            for name, value in values.items():
                row.setdefault(name, []).append(value)
        self._past = [*self._past[-2:], [c.astype(np.float64) for c in cloths]]
        if len(self._past) == 3:
            before, middle, after = self._past
            self._rows[-1]["acceleration_m_s2"] = [
                float(np.linalg.norm(a - 2 * m + b, axis=1).mean() * self._fps**2)
                for b, m, a in zip(before, middle, after, strict=True)
            ]
        self._rows.append(row)
        return row

    def _contact(self, cloths: Sequence[np.ndarray], body: np.ndarray) -> list[dict[str, float]]:
        """What each garment has to do with the body."""
        if not self._carried:
            self._carried = [_choose_followed(cloth, body) for cloth in cloths]
        surface = self._surface_at(body)
        distance, inside = surface.locate(np.concatenate(cloths))
        within = np.flatnonzero(inside)
        unfolded = within[~surface.in_folds(within, _FOLD_M)]
        ends = np.cumsum([len(cloth) for cloth in cloths])
        found = []
        for end, cloth, (chosen, carrier) in zip(ends, cloths, self._carried, strict=True):
            first = end - len(cloth)
            values = contact_measures(distance[first:end], inside[first:end])
            here = unfolded[(unfolded >= first) & (unfolded < end)]
            values["inside_open_share"] = len(here) / len(cloth)
            values["depth_open_m"] = float(distance[here].max(initial=0))
            way = np.linalg.norm(cloth[chosen] - carrier(body), axis=1)
            values["slip_m"] = float(np.median(way)) if len(way) else 0.0
            found.append(values)
        return found

    def _crossings_of(self, cloths: Sequence[np.ndarray]) -> Crossings:
        """Crossings of all garments, indexed in the first frame."""
        if self._crossings is None:
            self._crossings = Crossings(cloths, self._faces_of)
        return self._crossings

    def _surface_at(self, body: np.ndarray) -> MovingSurface:
        """The body's surface, indexed in the first frame."""
        if self._surface is None:
            assert self._faces is not None
            self._surface = MovingSurface(body, self._faces)
        self._surface.move(body)
        return self._surface

    def _inner_layers(self, cloths: Sequence[np.ndarray]) -> list[MovingSheet]:
        """Garments under another one, indexed in the first frame."""
        if len(self._sheets) < len(cloths) - 1:
            self._sheets = list(map(MovingSheet, cloths[:-1], self._triangles[:-1]))
        for sheet, cloth in zip(self._sheets, cloths, strict=False):
            sheet.move(cloth)
        return self._sheets

    def arrays(self) -> dict[str, np.ndarray]:
        """Measure -> (frames, garments) float32; unmeasured entries are NaN."""
        if not self._rows:
            return {}
        return {
            name: np.array([row[name] for row in self._rows], dtype=np.float32)
            for name in self._rows[0]
        }


def _choose_followed(cloth: np.ndarray, body: np.ndarray) -> tuple[np.ndarray, Carrier]:
    """Some vertices that lie close to the body, and what moves them along with it."""
    distance, _ = KDTree(body).query(cloth)
    near = np.flatnonzero(distance < _NEAR_M)
    chosen = near[:: max(1, len(near) // _FOLLOWED)]
    return chosen, Carrier(cloth[chosen].astype(np.float64), body)


def contact_measures(distance: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    """`inside_share`, deepest and mean depth inside; 5th and 50th percentile of gaps outside."""
    depth, gap = distance[inside], distance[~inside]
    low, middle = np.percentile(gap, [5, 50]) if len(gap) else (0.0, 0.0)
    return {
        "inside_share": float(inside.mean()),
        "depth_max_m": float(depth.max(initial=0)),
        "depth_mean_m": float(depth.mean()) if len(depth) else 0.0,
        "gap_p05_m": float(low),
        "gap_p50_m": float(middle),
    }


def _watched_edges(garment: HealthGarment) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2) that are watched, and their rest lengths (E,)."""
    watched = np.isfinite(garment.rest_lengths_m)
    return edges(garment.faces)[watched], garment.rest_lengths_m[watched]


def stretch(cloth: np.ndarray, pairs: np.ndarray, rest_lengths_m: np.ndarray) -> dict[str, float]:
    """1st, 50th and 99th percentile of the lengths of edges (E, 2) over their rest lengths (E,)."""
    start, end = pairs.T
    ways = cloth[start] - cloth[end]
    ratio = np.sqrt(np.einsum("ei,ei->e", ways, ways)) / rest_lengths_m
    low, middle, high = np.percentile(ratio, [1, 50, 99]) if len(ratio) else 3 * [np.nan]
    return {"stretch_p01": float(low), "stretch_p50": float(middle), "stretch_p99": float(high)}


def summary(arrays: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Numbers of a sample that `HealthBounds` judge, each of its worst garment.

    Those of contact are there if a body was, those of openings if its joints were.
    """
    mean = {name: _mean_over_frames(values) for name, values in arrays.items()}
    found = {}
    if "inside_share" in arrays:
        found = {
            "inside_share_mean": mean["inside_share"].max(),
            "inside_open_mean": mean["inside_open_share"].max(),
            "inside_open_max": arrays["inside_open_share"].max(),
            "depth_m": np.percentile(arrays["depth_open_m"], 95, axis=0).max(),
            "slip_m": arrays["slip_m"].max(),
            "gap_p05_m": mean["gap_p05_m"].min(),
        }
    if "lost_openings" in arrays:
        found["lost_openings"] = mean["lost_openings"].max()
    found |= {
        "stretch_low": mean["stretch_p01"].min(),
        "stretch_high": mean["stretch_p99"].max(),
        "layer_share_mean": mean["layer_share"].max(),
        "self_share_mean": mean["self_share"].max(),
        "self_crossings_max": arrays["self_crossings"].max(),
        "layer_crossings_max": arrays["layer_crossings"].max(),
        "acceleration_m_s2": mean["acceleration_m_s2"].max(),
        "settling_m_s": mean["settling_m_s"].max(),
    }
    return {name: float(value) for name, value in found.items()}


def _mean_over_frames(values: np.ndarray) -> np.ndarray:
    """Mean of the numbers in each column of (N, ...), NaN where there is none."""
    count = (~np.isnan(values)).sum(axis=0)
    total = np.nansum(values, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def inevitable_violations(
    arrays: Mapping[str, np.ndarray], bounds: HealthBounds, frames: int
) -> list[str]:
    """Violations after so many frames even if all that are to come are without fault."""
    missing = ((0, frames - len(arrays["slip_m"])), (0, 0))
    names = ("inside_open_share", "depth_open_m", "slip_m", "layer_share", "lost_openings")
    best = {name: np.pad(arrays[name], missing) for name in names if name in arrays}
    measures = {
        "inside_open_mean": float(best["inside_open_share"].mean(axis=0).max()),
        "inside_open_max": float(best["inside_open_share"].max()),
        "depth_m": float(np.percentile(best["depth_open_m"], 95, axis=0).max()),
        "slip_m": float(best["slip_m"].max()),
        "layer_share_mean": float(best["layer_share"].mean(axis=0).max()),
    }
    if "lost_openings" in best:
        measures["lost_openings"] = float(best["lost_openings"].mean(axis=0).max())
    return violations(measures, bounds)


def violations(measures: Mapping[str, float], bounds: HealthBounds) -> list[str]:
    """One phrase per measure that is outside its bound, with both values."""
    phrases = []
    for name, bound in bounds:
        if name not in measures:
            continue
        value = measures[name]
        low = name == "stretch_low"
        if not (value >= bound if low else value <= bound):
            phrases.append(
                f"{name} {value:.4g}, expected at {'least' if low else 'most'} {bound:g}"
            )
    return phrases
