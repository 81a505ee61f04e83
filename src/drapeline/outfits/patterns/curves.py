"""Curves and outlines that give panels their shape."""

import numpy as np

from drapeline.outfits.dress_form import ANGLES, STEP_M, Tube


def space_evenly(curve: np.ndarray, edges: int) -> np.ndarray:
    """Resample a polyline (P, 3) or (P, 2) at `edges` + 1 points of equal distances."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0, length[-1], edges + 1)
    return np.stack([np.interp(at, length, curve[:, k]) for k in range(curve.shape[1])], axis=1)


def curve_length(curve: np.ndarray) -> float:
    """Length of a polyline in metres."""
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def smoothstep(x: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, smooth between."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def hang(tube: Tube, *, down: float, up: float, top_m: float) -> Tube:
    """Let cloth hang over a tube rather than cling to it.

    Going down, cloth comes back towards the body by no more than `down` metres per metre, going
    up by no more than `up`: hollows under a bust or belly are bridged.

    Args:
        tube: outline of the body.
        down, up: metres per metre.
        top_m: where the cloth hangs from; slices above keep their outline.
    """
    radius = tube.radius.copy()
    last = int(np.clip((top_m - tube.start_m) / STEP_M, 0, len(radius) - 1))
    for row in range(last - 1, -1, -1):
        radius[row] = np.maximum(radius[row], radius[row + 1] - down * STEP_M)
    for row in range(1, last + 1):
        radius[row] = np.maximum(radius[row], radius[row - 1] - up * STEP_M)
    return Tube(tube.start_m, tube.centre, radius)


def straighten(tube: Tube, slope: float) -> Tube:
    """Let the radius of a limb change by no more than `slope` metres per metre, as sleeves' do.

    Bulges of muscles, elbows and knees are bridged on both sides.
    """
    radius = tube.radius.copy()
    for row in range(1, len(radius)):
        radius[row] = np.maximum(radius[row], radius[row - 1] - slope * STEP_M)
    for row in range(len(radius) - 2, -1, -1):
        radius[row] = np.maximum(radius[row], radius[row + 1] - slope * STEP_M)
    return Tube(tube.start_m, tube.centre, radius)


def ring(tube: Tube, height_m: float, extra_m: float, edges: int) -> np.ndarray:
    """Horizontal outline of a torso or skirt, (edges, 3).

    Starts at the right side seam and runs over the front, the left side and the back; each
    quarter has equal steps.
    """
    front = _arc(tube, height_m, extra_m, -np.pi / 2, -3 * np.pi / 2, edges // 2)
    back = _arc(tube, height_m, extra_m, np.pi / 2, -np.pi / 2, edges // 2)
    flat = np.concatenate([front[:-1], back[:-1]])
    return np.column_stack([flat, np.full(len(flat), height_m)])


def limb_loop(
    tube: Tube, along_m: float, extra_m: float, start: float, edges: int, turn: int = 1
) -> np.ndarray:
    """Outline (edges, 2) of a limb's slice; each half has equal steps.

    Args:
        extra_m: added to every radius.
        start: angle of the first point; the middle point lies opposite.
        turn: 1 for growing angles, -1 for falling ones.
    """
    half = turn * np.pi
    first = _arc(tube, along_m, extra_m, start, start + half, edges // 2)
    second = _arc(tube, along_m, extra_m, start + half, start + 2 * half, edges // 2)
    return np.concatenate([first[:-1], second[:-1]])


def _arc(tube: Tube, along_m: float, extra_m: float, a: float, b: float, edges: int) -> np.ndarray:
    angle = np.linspace(a, b, ANGLES)
    radius = tube.radius_at(np.full(ANGLES, along_m), angle % (2 * np.pi)) + extra_m
    outline = tube.centre_at(along_m) + radius[:, None] * np.stack(
        [np.sin(angle), np.cos(angle)], axis=1
    )
    return space_evenly(outline, edges)
