"""Upper-body patterns: front, back and sleeves of t-shirts, shirts, polos and tops."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drapeline.geometry.smoothing import averaging_matrix, equalise_edges, smooth
from drapeline.outfits.dress_form import ANGLES, DressForm, Tube
from drapeline.outfits.patterns.collar import Collar, add_collar
from drapeline.outfits.patterns.curves import (
    curve_length,
    hang,
    limb_loop,
    ring,
    smoothstep,
    space_evenly,
    straighten,
)
from drapeline.outfits.patterns.panels import Pattern
from drapeline.outfits.patterns.width_profile import WidthLine

GAP_M = 0.005  # cloth to dress form
_LEAST_JOINED = 2  # rows that a shirt with buttons keeps closed
_PARTS_M = 0.1  # from where fronts are joined to where they are 8 mm apart


@dataclass(frozen=True)
class UpperCut:
    """Measures of an upper-body garment, metres."""

    hem: float  # height of the lower end
    ease: float  # distance added around the chest; `flare` more for each metre below it
    flare: float  # metres per metre
    shaping: float  # how fast cloth comes back to the body below the chest, metres per metre
    drop: float  # the underarm's distance below the body's armpit
    shoulder_x: float  # outer end of the shoulder seam
    neck_x: float  # half width of the neckline at the shoulder seam
    neck_depth: float  # how far the neckline comes down in front
    neck_depth_back: float  # the same behind
    neckline: str  # "crew", "v" or "scoop"
    scye: float  # how far armholes are cut inwards between shoulder and underarm
    sleeve_x: float | None  # where sleeves end along the arm; None means no sleeves
    sleeve: WidthLine | None  # width along the arm, x from the shoulder joint
    front: str  # "closed", "polo", "buttoned" or "open"
    placket: float  # length of the opening below the neck, of polos and shirts with buttons
    below: float  # height below which a shirt with buttons is open again
    collar: Collar | None


@dataclass(frozen=True)
class _Counts:
    """Numbers of edges: around half the chest, armhole bottom and side, shoulder, notches.

    `rows` lie below the underarm, the upper `loose` of which are shaped with the shoulders.
    """

    half: int
    bottom: int
    side: int
    shoulder: int
    front_notch: int
    back_notch: int
    rows: int
    loose: int


def build_upper(
    pattern: Pattern,
    form: DressForm,
    cut: UpperCut,
    edge_length_m: float,
    half_ring: int | None = None,
) -> None:
    """Add an upper-body garment to a pattern.

    Args:
        half_ring: edges of half the chest ring, even; from the edge length if None.
    """
    underarm = form.landmarks["armpit"] - cut.drop
    trunk = hang(form.torso, down=cut.shaping, up=0.5, top_m=underarm)
    armholes = {name: _armhole(form, cut, underarm, trunk, y) for name, y in _FACES}
    necks = {name: _neckline(form, cut, y) for name, y in _FACES}
    counts = _count(form, cut, underarm, armholes, necks, edge_length_m, half_ring)
    front, back = _torso(pattern, trunk, cut, underarm, counts)
    points = pattern.vertices
    free = np.zeros(len(points), dtype=bool)
    free[front[-counts.loose - counts.side :]] = free[back[-counts.loose - counts.side :]] = True
    for name, ids in (("front", front), ("back", back)):
        borders = _borders(form, cut, ids, counts, armholes[name], necks[name], name)
        for border_ids, curve in borders:
            points[border_ids] = curve
            free[border_ids] = False
    for ids in (front, back):
        pattern.add_panel(ids, counts.half // 2)
    average = averaging_matrix(pattern.faces(), len(points))
    level = _leveller(form, cut, underarm)

    def lift(points: np.ndarray) -> np.ndarray:
        return form.upper.lift(points, level(points))

    for ids in (front, back):
        _fill_columns(points, ids, free)
        _follow_armholes(points, ids, free, counts)
    points = lift(points)
    points = smooth(points, average, np.where(free, 1.0, 0.0), 12, lift)
    pattern.vertices = equalise_edges(points, pattern.faces(), free, 8, lift)
    _mark_rings(pattern, front, back, counts)
    pattern.panels = pattern.panels[:-2]
    _front_panels(pattern, cut, front, counts, edge_length_m)
    pattern.add_panel(back, counts.half // 2)
    if cut.collar is not None:
        neck = _open_neck(front, back, counts, pattern.marks["placket"][-1])
        add_collar(pattern, form, cut.collar, neck, level, edge_length_m)
    if cut.sleeve_x is not None and cut.sleeve is not None:
        for side in ("left", "right"):
            _sleeve(pattern, form, (cut.sleeve_x, cut.sleeve), side, edge_length_m)


def chest_half_ring(form: DressForm, cut: UpperCut, edge_length_m: float) -> int:
    """Edges of half the chest ring (even) for a target edge length."""
    chest = ring(form.torso, form.landmarks["armpit"] - 0.06, GAP_M + cut.ease, 64)
    return max(16, 2 * round(curve_length(chest) / edge_length_m / 4))


_FACES = (("front", -1.0), ("back", 1.0))


def _ridge(form: DressForm, x_m: np.ndarray) -> np.ndarray:
    """Points (X, 3) on top of the shoulders, above `x_m`, one gap off the form."""
    y = np.arange(-0.12, 0.13, 0.01)
    z = np.arange(form.landmarks["shoulder"] - 0.06, form.landmarks["neck"] + 0.1, 0.004)
    grid = np.stack(np.meshgrid(x_m, y, z, indexing="ij"), axis=-1)
    inside = (form.upper.value(grid.reshape(-1, 3)) < GAP_M).reshape(grid.shape[:3])
    top = np.where(inside, z, z[0]).max(axis=2)  # (X, Y)
    weight = np.exp((top - top.max(axis=1, keepdims=True)) / 0.004)
    middle = (weight * y).sum(axis=1) / weight.sum(axis=1)
    return form.upper.land(np.column_stack([x_m, middle, top.max(axis=1)]), GAP_M)


def _armhole(form: DressForm, cut: UpperCut, underarm: float, trunk: Tube, y: float) -> np.ndarray:
    """Left armhole's front (y = -1) or back (y = 1) half from underarm to shoulder, (P, 3)."""
    axis_y = trunk.centre[0, 1]
    side_x = float(trunk.radius_at(np.array([underarm]), np.pi / 2)[0]) + GAP_M + cut.ease
    low = form.upper.lift(np.array([[side_x, axis_y, underarm]]), GAP_M + cut.ease)
    high = _ridge(form, np.array([cut.shoulder_x]))
    turn = np.linspace(0, np.pi, 41)[:, None]
    share = (1 - np.cos(turn)) / 2
    curve = low + (high - low) * share
    curve += np.sin(turn) * np.array([-cut.scye, 0.06 * y, 0.0])
    inner = curve[1:-1]
    for _ in range(4):
        ease = cut.ease * (1 - share[1:-1, 0])
        inner = form.upper.lift(inner, GAP_M + ease) if cut.sleeve_x else inner
        inner = form.upper.land(inner, GAP_M) if not cut.sleeve_x else inner
        curve = np.concatenate([low, inner, high])
        inner = (curve[:-2] + 2 * curve[1:-1] + curve[2:]) / 4
    return curve


def _neckline(form: DressForm, cut: UpperCut, y: float) -> np.ndarray:
    """Neckline in front (y = -1) or behind (y = 1), left neck point to right, (P, 3)."""
    high = _ridge(form, np.array([cut.neck_x]))[0]
    depth = cut.neck_depth if y < 0 else cut.neck_depth_back
    t = np.linspace(0, 1, 31)  # from the neck point to the middle
    power = {"crew": 2.0, "scoop": 2.6, "v": 1.25}[cut.neckline] if y < 0 else 2.4
    x = high[0] * (1 - t)
    z = high[2] - depth * (1 - (1 - t) ** power) ** (1 / power if cut.neckline != "v" else 1)
    surface = form.upper.land(np.array([[0.0, 0.3 * y, high[2] - depth]]), GAP_M)[0, 1]
    guess = np.column_stack([x, high[1] + (surface - high[1]) * np.sin(t * np.pi / 2) ** 0.7, z])
    half = guess.copy()
    half[1:] = form.upper.land(guess[1:], GAP_M)
    half[:, 0] = np.maximum(half[:, 0], 0)
    half[-1, 0] = 0.0
    return np.concatenate([half, half[-2::-1] * [-1, 1, 1]])


def _count(
    form: DressForm,
    cut: UpperCut,
    underarm: float,
    armholes: Mapping[str, np.ndarray],
    necks: Mapping[str, np.ndarray],
    edge_length_m: float,
    half_ring: int | None,
) -> _Counts:
    e = edge_length_m
    half = half_ring or chest_half_ring(form, cut, e)
    length = (curve_length(armholes["front"]) + curve_length(armholes["back"])) / 2
    total = max(6, round(length / e))
    seam = _ridge(form, np.linspace(cut.neck_x, cut.shoulder_x, 8))
    shoulder = max(2, round(curve_length(seam) / e))
    # Narrow straps leave few columns between the armholes: the others end at their lower edge.
    bottom = int(np.clip(round(0.3 * total), 1, half // 2 - shoulder - 2))
    side = max(4, total - bottom)
    neck = half - 2 * bottom - 2 * shoulder
    front, back = (
        int(np.clip(round((curve_length(necks[n]) / e - neck) / 2), 0, side - 2))
        for n in ("front", "back")
    )
    rows = max(3, round((underarm - cut.hem) / e))
    loose = min(rows - 1, round(0.06 / e))
    return _Counts(half, bottom, side, shoulder, front, back, rows, loose)


def _torso(
    pattern: Pattern, trunk: Tube, cut: UpperCut, underarm: float, n: _Counts
) -> tuple[np.ndarray, np.ndarray]:
    """Grids of ids (rows + side + 1, half + 1) of front and back, seams shared."""
    height = np.linspace(cut.hem, underarm, n.rows + 1)
    rings = np.stack(
        [
            ring(trunk, z, GAP_M + cut.ease + cut.flare * max(0.0, underarm - z), 2 * n.half)
            for z in height
        ]
    )
    around = pattern.add_vertices(rings)
    shape = (n.rows + n.side + 1, n.half + 1)
    front, back = np.full(shape, -1), np.full(shape, -1)
    front[: n.rows + 1] = around[:, : n.half + 1]
    back[: n.rows + 1] = np.column_stack([around[:, n.half :], around[:, :1]])
    left, right = n.bottom + n.shoulder, n.half - n.bottom - n.shoulder
    for grid, notch in ((front, n.front_notch), (back, n.back_notch)):
        hole = np.ones(shape, dtype=bool)
        hole[n.rows + 1 :, n.bottom : n.half - n.bottom + 1] = False
        hole[n.rows + n.side + 1 - notch :, left + 1 : right] = True
        hole[: n.rows + 1] = True
        if grid is back:  # the shoulder seams belong to the front
            for c in [*range(n.bottom, left + 1), *range(right, n.half - n.bottom + 1)]:
                back[-1, n.half - c] = front[-1, c]
                hole[-1, n.half - c] = True
        grid[~hole] = pattern.add_vertices(np.zeros((int((~hole).sum()), 3)))
    return front, back


def _fill_columns(points: np.ndarray, ids: np.ndarray, free: np.ndarray) -> None:
    """Put every column's free vertices evenly between the held ones at its two ends."""
    for column in ids.T:
        line = column[column >= 0]
        loose = np.flatnonzero(free[line])
        if len(loose):
            low, high = loose[0] - 1, loose[-1] + 1
            share = np.linspace(0, 1, high - low + 1)[:, None]
            ends = points[line[[low, high]]]
            points[line[low : high + 1]] = ends[0] + share * (ends[1] - ends[0])


def _follow_armholes(points: np.ndarray, ids: np.ndarray, free: np.ndarray, n: _Counts) -> None:
    """Bend the columns between the armholes as the armholes are bent, less towards the middle.

    Straight columns would run across an armhole that is cut inwards.
    """
    low = n.rows - n.loose
    share = np.linspace(0, 1, len(ids) - low)[:, None]
    middle = n.half / 2
    for edge, step in ((n.bottom, 1), (n.half - n.bottom, -1)):
        line = points[ids[low:, edge]]
        bend = line - (line[0] + share * (line[-1] - line[0]))
        for offset in range(1, int(middle - n.bottom)):
            column = ids[low:, edge + step * offset]
            loose = (column >= 0) & free[column]
            points[column[loose]] += bend[loose] * (1 - offset / (middle - n.bottom))


def _borders(
    form: DressForm,
    cut: UpperCut,
    ids: np.ndarray,
    n: _Counts,
    armhole: np.ndarray,
    neck: np.ndarray,
    name: str,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(ids, positions) of armholes, neckline and shoulder seams of one panel."""
    mirror = np.array([-1.0, 1.0, 1.0])
    curve = space_evenly(armhole, n.bottom + n.side)
    # Columns of the front run from the right to the left, those of the back the other way.
    left = -1.0 if name == "back" else 1.0
    first = np.concatenate([ids[n.rows, : n.bottom], ids[n.rows :, n.bottom]])
    last = np.concatenate([ids[n.rows, ::-1][: n.bottom], ids[n.rows :, n.half - n.bottom]])
    yield first, curve * (mirror if left > 0 else 1)
    yield last, curve * (1 if left > 0 else mirror)
    a, b = n.bottom + n.shoulder, n.half - n.bottom - n.shoulder
    notch = n.front_notch if name == "front" else n.back_notch
    top = len(ids) - 1
    line = np.concatenate(
        [ids[top - notch : top + 1, a][::-1], ids[top - notch, a + 1 : b], ids[top - notch :, b]]
    )
    ring_points = space_evenly(neck, len(line) - 1)  # left to right of the body
    yield line, ring_points[::-1] if left > 0 else ring_points
    if name == "front":
        seam = space_evenly(_ridge(form, np.linspace(cut.shoulder_x, cut.neck_x, 12)), n.shoulder)
        yield ids[top, n.bottom : a + 1], seam * mirror
        yield ids[top, b : n.half - n.bottom + 1], seam[::-1]


def _leveller(
    form: DressForm, cut: UpperCut, underarm: float
) -> Callable[[np.ndarray], np.ndarray]:
    """A function from points (P, 3) to distances (P,) off the form: more where there is ease."""
    top = form.landmarks["shoulder"]

    def level(points: np.ndarray) -> np.ndarray:
        return GAP_M + cut.ease * smoothstep((top - points[:, 2]) / (top - underarm))

    return level


def _mark_rings(pattern: Pattern, front: np.ndarray, back: np.ndarray, n: _Counts) -> None:
    """Armholes from the underarm (left over the front, right over the back), hem, shoulders."""
    far = n.half - n.bottom
    pattern.marks["shoulders"] = front[-1][front[-1] >= 0]
    pattern.marks["hem"] = np.concatenate([front[0, :-1], back[0, :-1]])
    pattern.marks["left_armhole"] = np.concatenate(
        [
            front[n.rows, far + 1 :][::-1],
            front[n.rows :, far],
            back[n.rows :, n.bottom][::-1][1:],
            back[n.rows, 1 : n.bottom][::-1],
        ]
    )
    pattern.marks["right_armhole"] = np.concatenate(
        [
            back[n.rows, far + 1 :][::-1],
            back[n.rows :, far],
            front[n.rows :, n.bottom][::-1][1:],
            front[n.rows, 1 : n.bottom][::-1],
        ]
    )


def _front_panels(pattern: Pattern, cut: UpperCut, front: np.ndarray, n: _Counts, e: float) -> None:
    """One front panel, or two that part along the middle: a polo's placket, a shirt's fronts.

    "placket" marks both sides where they part, from the lowest to the highest: the right one, and
    its copies on the left.
    """
    middle = n.half // 2
    if cut.front == "closed":
        pattern.add_panel(front, middle)
        return
    column = front[:, middle]
    exists = np.flatnonzero(column >= 0)
    points = pattern.vertices
    away = np.full(len(exists), np.inf)  # rows from where the fronts are joined
    if cut.front != "open":
        high = int(max(n.rows // 2, exists[-1] - max(2, round(cut.placket / e))))
        low = int(np.sum(points[column[exists], 2] < cut.below)) if cut.front == "buttoned" else 0
        low = max(min(low, high - _LEAST_JOINED), 0)
        away = np.maximum(exists - high, low - exists).astype(float)
    parted = exists[away > 0]
    away = away[away > 0]
    copies = pattern.add_vertices(points[column[parted]])
    points = pattern.vertices
    gap = 0.002 + 0.006 * np.minimum(away * e / _PARTS_M, 1.0)
    points[copies, 0] += gap / 2
    points[column[parted], 0] -= gap / 2
    pattern.vertices = points
    right, left = front[:, : middle + 1], front[:, middle:].copy()
    left[parted, 0] = copies
    pattern.add_panel(right, middle)
    pattern.add_panel(left, 0)
    pattern.marks["placket"] = np.concatenate([column[parted], copies])


def _open_neck(front: np.ndarray, back: np.ndarray, n: _Counts, left: int) -> np.ndarray:
    """Ids of a neckline that is parted in front, from the left edge round the back to the right.

    Args:
        left: the upper corner of the left edge.
    """
    first, last = n.bottom + n.shoulder, n.half - n.bottom - n.shoulder
    lines = []
    for grid, notch in ((front, n.front_notch), (back, n.back_notch)):
        sides = grid[len(grid) - 1 - notch :, first][::-1], grid[len(grid) - 1 - notch :, last]
        low = grid[len(grid) - 1 - notch, first + 1 : last]
        lines.append(np.concatenate([sides[0], low, sides[1]]))
    middle = len(lines[0]) // 2
    return np.concatenate([[left], lines[0][middle + 1 :], lines[1][1:-1], lines[0][: middle + 1]])


def _sleeve(
    pattern: Pattern,
    form: DressForm,
    cut: tuple[float, WidthLine],
    side: str,
    edge_length_m: float,
) -> None:
    end_x, width = cut
    loop = pattern.marks[f"{side}_armhole"]
    sign = 1.0 if side == "left" else -1.0
    start = pattern.vertices[loop] * [sign, 1, 1]
    arm = straighten(form.arm, 0.07)
    length = end_x - start[:, 0].mean()
    rows = max(2, round(length / edge_length_m))
    shoulder_x = form.landmarks["shoulder_x"]
    grid = []
    for row in range(1, rows + 1):
        x = start[:, 0] + (end_x - start[:, 0]) * row / rows
        mean = x.mean()
        own = arm.radius_at(np.full(ANGLES, mean), np.arange(ANGLES) * 2 * np.pi / ANGLES).mean()
        wide = width(max(0.0, mean - shoulder_x)) / 2
        extra = max(GAP_M, wide - own)
        outline = limb_loop(arm, mean, extra, np.pi, len(loop), 1 if sign > 0 else -1)
        # Cloth lies on top of the arm; what it is wider hangs below.
        outline[:, 1] -= 0.75 * (extra - GAP_M)
        blend = smoothstep((mean - start[:, 0].mean()) / 0.1)
        plane = start[:, 1:] + blend * (outline - start[:, 1:])
        grid.append(np.column_stack([sign * x, plane]))
    ids = np.concatenate([loop[None], pattern.add_vertices(np.stack(grid))])
    closed = np.column_stack([ids, ids[:, :1]])[::-1]
    pattern.add_panel(closed, closed.shape[1] // 2)
    pattern.marks[f"{side}_cuff"] = ids[-1]
