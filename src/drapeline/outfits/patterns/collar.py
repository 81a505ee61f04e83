"""Turn-down collars of shirts and polos, sewn to a neckline that is open in front."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drapeline.outfits.dress_form import DressForm
from drapeline.outfits.patterns.panels import BETWEEN_FRONTS_M, Pattern

_LAYER_M = 0.009  # between the two layers of a collar, and from what it lies on
_ENDS_M = 0.06  # over which the ends give way to one another
_EVEN_M = 0.05  # over which the neckline's corners at the shoulders are evened out
_UP = np.array([0.0, 0.0, 1.0])
_SHALLOW_M, _DEEP_M, _NARROWEST = 0.1, 0.2, 0.15  # depths of necklines, and share of the width
_SEWN_SHARE = 0.9  # of a deep neckline's height
_LEAN = 0.3  # how far the stand leans towards the neck, metres per metre


@dataclass(frozen=True)
class Collar:
    """Measures of a collar, metres."""

    stand: float  # height along the neck
    fall: float  # width of what is turned down, behind
    point: float  # what that is wider in front


def add_collar(
    pattern: Pattern,
    form: DressForm,
    collar: Collar,
    neck: np.ndarray,
    level: Callable[[np.ndarray], np.ndarray],
    edge_length_m: float,
) -> None:
    """Sew a collar to a neckline; marks "collar", ids (R, C) with the neckline in the first row.

    Args:
        neck: (C,) ids from the left front edge around the back to the right one.
        level: distances (P,) from the form that the garment has at points (P, 3).
    """
    heights = pattern.vertices[neck, 2]
    deep = heights < heights.max() - max(_SHALLOW_M, _SEWN_SHARE * np.ptp(heights))
    neck = neck[~deep]
    base = pattern.vertices[neck]
    passes = max(2, round((_EVEN_M / edge_length_m) ** 2))
    even = _evened(base, passes)
    out = (base - base.mean(axis=0)) * [1, 1, 0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    # Square to the neckline: along a V, a stand leans inwards and its fall lies sideways.
    along = np.gradient(even, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = _UP - along * along[:, 2:]
    up = _evened(up / np.linalg.norm(up, axis=1, keepdims=True), passes)
    # Towards the lower end of a deep neckline a collar becomes narrow, as lapels do.
    depth = base[:, 2].max() - base[:, 2]
    share = np.clip(1 - (depth - _SHALLOW_M) / (max(depth.max(), _DEEP_M) - _SHALLOW_M), 0, 1)
    share = (_NARROWEST + (1 - _NARROWEST) * share)[:, None]
    # Away from the neck over what the stand is sewn to: down the back, outwards on the shoulders.
    normal = form.upper.direction(base)
    away = out - up - ((out - up) * normal).sum(axis=1, keepdims=True) * normal
    away = _evened(away / np.linalg.norm(away, axis=1, keepdims=True), passes)
    high = collar.stand * share
    crest = even + high * (up - _LEAN * out)
    crest = form.upper.lift(crest, level(crest))
    rows = max(1, round(collar.stand / edge_length_m))
    parts = (np.arange(1, rows + 1) / rows)[:, None, None]
    standing = base + parts * (crest - base)
    # Points in front: the width grows over the last fifth of either side.
    side = np.abs(np.linspace(-1, 1, len(neck)))[:, None]
    width = share * (collar.fall + collar.point * np.maximum(0, (side - 0.8) / 0.2))
    rows = max(1, round(collar.fall / edge_length_m))
    falling = []
    for part in np.arange(1, rows + 1) / rows:
        # Down beside the stand, and below it over what the stand is sewn to.
        height = high - part * width
        beside = np.clip(height / high, 0, 1)
        beneath = base + beside * (crest - base) + np.maximum(-height, 0) * away
        beneath = form.upper.lift(beneath, level(beneath))
        way = beside * out + (1 - beside) * form.upper.direction(beneath)
        over = beneath + _LAYER_M * way / np.linalg.norm(way, axis=1, keepdims=True)
        over = base + _evened(over - base, passes)
        falling.append(form.upper.lift(over, level(over) + _LAYER_M * (1 - beside[:, 0])))
    added = np.stack([*standing, *falling])
    # Neither half reaches over to the other's side.
    from_end = np.minimum(np.arange(len(neck)), np.arange(len(neck))[::-1]) * edge_length_m
    near = np.maximum(0, 1 - from_end / _ENDS_M)
    for end, sign in ((0, 1.0), (-1, -1.0)):
        lack = np.maximum(BETWEEN_FRONTS_M - sign * added[:, end, :1], 0)
        half = slice(None, len(neck) // 2) if end == 0 else slice(len(neck) // 2 + 1, None)
        added[:, half, 0] += sign * lack * near[half]
    ids = np.concatenate([neck[None], pattern.add_vertices(added)])
    pattern.add_panel(ids, len(neck) // 2)
    pattern.marks["collar"] = ids


def _evened(line: np.ndarray, passes: int) -> np.ndarray:
    """A polyline (P, 3) after passes of averaging that keep its ends."""
    line = line.copy()
    for _ in range(passes):
        line[1:-1] = (line[:-2] + 2 * line[1:-1] + line[2:]) / 4
    return line
