"""Lower-body patterns: trousers and skirts."""

from dataclasses import dataclass

import numpy as np

from drapeline.frames import REST_POSE
from drapeline.geometry.smoothing import averaging_matrix, smooth
from drapeline.outfits.dress_form import ANGLES, DressForm, Tube
from drapeline.outfits.patterns.curves import (
    curve_length,
    hang,
    limb_loop,
    ring,
    smoothstep,
    straighten,
)
from drapeline.outfits.patterns.panels import BETWEEN_LEGS_M, Pattern, separator
from drapeline.outfits.patterns.width_profile import WidthLine

GAP_M = 0.005
_LEG_TILT = float(np.tan(REST_POSE[5]))
_SEAM_M = 0.15  # over which a sewn waist evens out


@dataclass(frozen=True)
class TrousersCut:
    """Measures of trousers, metres."""

    waist: float  # height of the upper end
    cuff: float  # height of the lower ends on the legs' axes
    rise: float  # the crotch seam's distance below the body's crotch
    ease: float  # distance added around the hips
    leg: WidthLine  # width along the leg, x from the hip joint


@dataclass(frozen=True)
class SkirtCut:
    """Measures of a skirt, metres."""

    waist: float  # height of the upper end
    hem: float  # height of the lower end
    width: WidthLine  # width along the vertical axis, x from the waist
    flutes: int  # number of soft folds around the hem
    fullness: float  # depth of the folds at the hem in shares of its radius
    phase: float  # angle of the first fold, radians
    # Seeds of the unevenness of the folds, four numbers in [0, 1).
    wander: tuple[float, float, float, float]


def trousers_half_ring(form: DressForm, cut: TrousersCut, edge_length_m: float) -> int:
    """Edges of half the hip ring (even) for a target edge length."""
    hips = ring(form.torso, form.landmarks["hip"], GAP_M + cut.ease, 64)
    return max(12, 2 * round(curve_length(hips) / edge_length_m / 4))


def skirt_half_ring(form: DressForm, cut: SkirtCut, edge_length_m: float) -> int:
    """Edges of half the ring (even): right in the middle of the length."""
    middle = ring(form.skirt, (cut.waist + cut.hem) / 2, _skirt_extra(form, cut, 0.5), 64)
    return max(12, 2 * round(curve_length(middle) / edge_length_m / 4))


def build_trousers(
    pattern: Pattern,
    form: DressForm,
    cut: TrousersCut,
    edge_length_m: float,
    half_ring: int,
    waist_ids: np.ndarray | None = None,
) -> None:
    """Add trousers to a pattern.

    Args:
        half_ring: edges of half the hip ring, even.
        waist_ids: (2 half_ring,) existing vertices to sew the waist to, or None.
    """
    e = edge_length_m
    half = half_ring
    fork = form.landmarks["crotch"] + 0.045
    crotch = form.landmarks["crotch"] - cut.rise
    hips = hang(form.torso, down=0.05, up=0.45, top_m=cut.waist)
    rows = max(2, round((cut.waist - fork) / e))
    heights = np.linspace(cut.waist, fork, rows + 1)
    rings = np.stack([ring(hips, z, GAP_M + cut.ease, 2 * half) for z in heights])
    ids = _sew(pattern, rings, waist_ids)
    bridge = _bridge(pattern, ids[-1], half, crotch, e)
    legs = [_leg(pattern, form, cut, ids, bridge, side, e) for side in ("left", "right")]
    _settle_legs(pattern, form, bridge, fork)
    for leg in legs:
        _space_rows(pattern, leg)


def _sew(pattern: Pattern, rings: np.ndarray, waist_ids: np.ndarray | None) -> np.ndarray:
    """Ids (R, E) of rings (R, E, 3) from the waist down, the first merged with existing ones."""
    if waist_ids is None:
        ids = pattern.add_vertices(rings)
    else:
        # The lower part starts where the upper one ends and finds its own shape further down.
        shift = pattern.vertices[waist_ids] - rings[0]
        below = rings[0, 0, 2] - rings[1:, :1, 2:]
        rings = rings[1:] + shift * (1 - smoothstep(below / _SEAM_M))
        ids = np.concatenate([waist_ids[None], pattern.add_vertices(rings)])
    pattern.marks["waist"] = ids[0]
    return ids


def _bridge(
    pattern: Pattern, fork_ring: np.ndarray, half: int, crotch: float, e: float
) -> np.ndarray:
    """Add the vertices under the crotch from the back's middle to the front's, without ends."""
    points = pattern.vertices
    front, back = points[fork_ring[half // 2]], points[fork_ring[half + half // 2]]
    turn = np.linspace(0, np.pi, 41)
    share = (1 - np.cos(turn)) / 2
    curve = back + (front - back) * share[:, None]
    curve[:, 2] -= np.sin(turn) * (back[2] - crotch)
    curve[:, 0] = 0
    edges = max(4, 2 * round(curve_length(curve) / e / 2))
    at = np.linspace(0, np.pi, edges + 1)[1:-1]
    inner = np.column_stack([np.interp(at, turn, curve[:, k]) for k in range(3)])
    return pattern.add_vertices(inner)


def _leg(
    pattern: Pattern,
    form: DressForm,
    cut: TrousersCut,
    hips: np.ndarray,
    bridge: np.ndarray,
    side: str,
    e: float,
) -> np.ndarray:
    """Add one leg's two panels, hips included; ids (R, C) of its rows from the fork down."""
    half = hips.shape[1] // 2
    quarter, inner = half // 2, (len(bridge) + 1) // 2
    fork = hips[-1]
    sign = 1.0 if side == "left" else -1.0
    if side == "left":  # front middle -> side -> back middle -> under the crotch
        outer = fork[quarter : half + quarter + 1]
        loop = np.concatenate([outer, bridge])
    else:  # back middle -> side -> front middle -> under the crotch
        outer = np.concatenate([fork[half + quarter :], fork[: quarter + 1]])
        loop = np.concatenate([outer, bridge[::-1]])
    start = pattern.vertices[loop] * [sign, 1, 1]
    limb = straighten(form.leg, 0.1)
    length = start[:, 2].mean() - cut.cuff
    rows = max(1, round(length / e))
    grid = [
        _leg_row(form, limb, cut, start, row / rows, quarter, 1 if sign > 0 else -1) * [sign, 1, 1]
        for row in range(1, rows + 1)
    ]
    ids = np.concatenate([loop[None], pattern.add_vertices(np.stack(grid))])
    pattern.marks[f"{side}_leg_cuff"] = ids[-1]
    pattern.marks[f"{side}_leg"] = ids[1:].ravel()
    # Columns from the inseam over the first half to the outer side, and on to the inseam.
    turned = np.roll(ids, inner, axis=1)
    turned = np.column_stack([turned, turned[:, :1]])
    middle = inner + quarter
    above = np.full((len(hips) - 1, turned.shape[1]), -1)
    if side == "left":
        above[:, inner : inner + half + 1] = hips[:-1, quarter : half + quarter + 1]
    else:
        above[:, inner : inner + half + 1] = np.concatenate(
            [hips[:-1, half + quarter :], hips[:-1, : quarter + 1]], axis=1
        )
    whole = np.concatenate([above, turned])[::-1]
    pattern.add_panel(whole[:, : middle + 1], middle)
    pattern.add_panel(whole[:, middle:], 0)
    return ids


def _leg_row(
    form: DressForm,
    limb: Tube,
    cut: TrousersCut,
    start: np.ndarray,
    share: float,
    quarter: int,
    turn: int,
) -> np.ndarray:
    """Row of a left leg between the fork (0) and the cuff (1); the cuff is square to the leg."""
    axis_x = limb.centre_at(np.array(cut.cuff))[0]
    x = start[:, 0]
    for _ in range(3):
        cuff_z = cut.cuff + _LEG_TILT * (x - axis_x)
        z = start[:, 2] + (cuff_z - start[:, 2]) * share
        mean = float(z.mean())
        own = limb.radius_at(np.full(ANGLES, mean), np.arange(ANGLES) * 2 * np.pi / ANGLES).mean()
        along = max(0.0, (form.landmarks["hip"] - mean) * np.hypot(1, _LEG_TILT))
        extra = max(GAP_M, cut.leg(along) / 2 - own)
        # The outline starts at the outer side; the row starts a quarter before it.
        outline = limb_loop(limb, mean, extra, np.pi / 2, len(start), -turn)
        plane = np.roll(outline, quarter, axis=0)
        blend = smoothstep((start[:, 2].mean() - mean) / 0.16)
        flat = start[:, :2] + blend * (plane - start[:, :2])
        x = flat[:, 0]
    return np.column_stack([np.maximum(flat[:, 0], BETWEEN_LEGS_M), flat[:, 1], z])


def _settle_legs(pattern: Pattern, form: DressForm, bridge: np.ndarray, fork: float) -> None:
    points = pattern.vertices
    average = averaging_matrix(pattern.faces(), len(points))
    near = 1 - smoothstep((np.abs(points[:, 2] - fork + 0.04) - 0.06) / 0.06)
    for name in ("waist", "left_leg_cuff", "right_leg_cuff"):
        near[pattern.marks[name]] = 0
    if "hem" in pattern.marks:
        near[points[:, 2] >= points[pattern.marks["waist"], 2].min()] = 0
    moved = near > 0
    on_middle = np.isin(np.arange(len(points)), bridge)
    on_middle |= np.abs(points[:, 0]) < 1e-6
    separate = separator(pattern)

    def lift(p: np.ndarray) -> np.ndarray:
        whole = points.copy()
        whole[moved] = form.lower.lift(p, GAP_M)
        whole[on_middle, 0] = 0
        return separate(whole)[moved]

    pattern.vertices = smooth(points, average, 0.8 * near, 25, lift)


def _space_rows(pattern: Pattern, leg: np.ndarray) -> None:
    """Slide the vertices of each of a leg's columns (R, C) along it, to equal distances.

    Between the thighs there is little room, into which rows that settle crowd below the seam.
    """
    points = pattern.vertices.copy()
    columns = points[leg]
    way = np.linalg.norm(np.diff(columns, axis=0), axis=2).cumsum(axis=0)
    way = np.concatenate([np.zeros((1, leg.shape[1])), way])
    share = np.linspace(0, 1, len(leg))
    for column in range(leg.shape[1]):
        at = share * way[-1, column]
        for axis in range(3):
            columns[:, column, axis] = np.interp(at, way[:, column], columns[:, column, axis])
    points[leg] = columns
    pattern.vertices = points


def _skirt_extra(form: DressForm, cut: SkirtCut, share: float) -> float:
    """Distance of the cloth from the hips' outline at a share of the length."""
    x = share * (cut.waist - cut.hem)
    return GAP_M + max(0.0, float(cut.width(x)) - cut.width.w0_m) / 2


def build_skirt(
    pattern: Pattern,
    form: DressForm,
    cut: SkirtCut,
    edge_length_m: float,
    half_ring: int,
    waist_ids: np.ndarray | None = None,
) -> None:
    """Add a skirt to a pattern.

    Args:
        half_ring: edges of half the ring, even.
        waist_ids: (2 half_ring,) existing vertices to sew the waist to, or None.
    """
    hips = hang(form.skirt, down=0.02, up=0.45, top_m=cut.waist)
    rows = max(2, round((cut.waist - cut.hem) / edge_length_m))
    grid = [_skirt_ring(form, cut, hips, row / rows, 2 * half_ring) for row in range(rows + 1)]
    ids = _sew(pattern, np.stack(grid), waist_ids)
    pattern.marks["skirt_hem"] = ids[-1]
    closed = np.column_stack([ids, ids[:, :1]])[::-1]
    pattern.add_panel(closed[:, : half_ring + 1], half_ring // 2)
    pattern.add_panel(closed[:, half_ring:], half_ring // 2)


def _skirt_ring(form: DressForm, cut: SkirtCut, hips: Tube, share: float, edges: int) -> np.ndarray:
    z = cut.waist + (cut.hem - cut.waist) * share
    out = ring(hips, z, _skirt_extra(form, cut, share), edges)
    axis = np.array([0.0, hips.centre[0, 1]])
    spoke = out[:, :2] - axis
    angle = np.arctan2(spoke[:, 1], spoke[:, 0])
    w = cut.wander
    # Folds of uneven spacing and depth, none at the waist and deepest at the hem.
    bent = angle + 0.16 * np.sin(angle * 2 + 6.3 * w[0]) + 0.1 * np.sin(angle * 3 + 6.3 * w[1])
    depth = 1 + 0.35 * np.sin(angle * 3 + 6.3 * w[2]) + 0.2 * np.sin(angle * 5 + 6.3 * w[3])
    wave = np.cos(cut.flutes * bent + cut.phase) * depth
    grow = share**1.3 * cut.fullness
    out[:, :2] = axis + spoke * (1 + grow * (wave + 0.6))[:, None]
    return out
