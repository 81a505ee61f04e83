"""What of a moving body bears its weight on the floor z = 0, and when it flies.

Points of the body are grouped by the segment that they belong to. N frames at 30 fps, K points,
S = 24 segments.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import (
    binary_closing,
    binary_dilation,
    binary_opening,
    gaussian_filter1d,
    label,
    minimum_filter1d,
)

from drapeline.frames import FPS, JOINT_NAMES, PARENTS

GRAVITY_M_S2 = 9.81
SEGMENTS = len(JOINT_NAMES)
# Shares of body mass: P. de Leva, Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters,
# J. Biomech. 29, 1996, means of women and men; trunk and head divided at SMPL's joints.
_MASS = {
    "pelvis": 0.119, "spine1": 0.078, "spine2": 0.078, "spine3": 0.116, "neck": 0.018, "head": 0.05,
    "hip": 0.145, "knee": 0.046, "ankle": 0.009, "foot": 0.004, "collar": 0.02, "shoulder": 0.026,
    "elbow": 0.015, "wrist": 0.003, "hand": 0.003,
}  # fmt: skip
_SHARES = np.array([_MASS[name.split("_")[-1]] for name in JOINT_NAMES])
MASS_SHARES = _SHARES / _SHARES.sum()
PATCH_M = 0.004  # what is this much above a segment's lowest point bears 1/e of the weight there

_HIGH_M = 0.10  # a body that is so high above the floor is in the air if it falls at all
_OFF_M = 0.012  # and so high if it falls much like a stone
_FALLING_M_S2 = -0.4 * GRAVITY_M_S2
_SINKING_M_S2 = -0.2 * GRAVITY_M_S2  # on average, over a whole flight
_LOW_M = 0.035  # above the lowest point of all: a segment that may be standing
_SLOW_M_S = 0.45
_MIN_FRAMES = 3
_FLOOR_FRAMES = 3.0
_FLIGHT_FRAMES = 12  # within so many frames of a flight the body is on the floor
_LEAVING_M = 0.015  # per frame
_LEFT_M = 0.025


# Parts that stand, lie or lean on the floor, by their segments.
PARTS = {
    **{
        f"{side}_{name}": [JOINT_NAMES.index(f"{side}_{segment}") for segment in segments]
        for side in ("left", "right")
        for name, segments in {
            "foot": ("ankle", "foot"), "knee": ("knee",), "upper_arm": ("shoulder",),
            "elbow": ("elbow",), "hand": ("wrist", "hand"),
        }.items()
    },
    "seat": [0, 1, 2],
    "back": [3, 6, 9, 13, 14],
    "head": [12, 15],
}  # fmt: skip
BEARING_M = 0.005  # a vertex that is no higher bears weight
HOVER_M = 0.010  # and a body whose vertices are all higher than this has left the floor


class FloorContact(NamedTuple):
    """Contact of a body in motion with the floor z = 0, by its vertices."""

    penetration_m: float  # greatest depth of any vertex below the floor
    # Mean horizontal speed of the patches that parts of the body (`PARTS`) stand on, over patches
    # and frames; 0 if nothing ever stands.
    sliding_m_s: float
    # Of the times in which nothing is within 1 cm of the floor the one that is longest for its
    # height, and how long a body flies that rises so high: 2 sqrt(2 h / g).
    hover_s: float
    flight_s: float


def floor_contact(vertices: np.ndarray, path: np.ndarray, segmentation: np.ndarray) -> FloorContact:
    """Measure how a body meets the floor.

    Args:
        vertices: (N, V, 3) relative to the root joint, metres.
        path: (N, 3) the root joint, metres.
        segmentation: (V,) the joint whose part each vertex belongs to.
    """
    lowest = vertices[..., 2].min(axis=1) + path[:, 2]
    speeds = []
    for segments in PARTS.values():
        part = vertices[:, np.isin(segmentation, segments)] + path[:, None]
        bears = part[..., 2] < BEARING_M
        both = bears[1:] & bears[:-1]
        stands = both.any(axis=1)
        step = np.einsum("nva,nv->na", np.diff(part[..., :2], axis=0), both)[stands]
        speeds.append(np.linalg.norm(step, axis=1) / both[stands].sum(axis=1) * FPS)
    hover, flight = _worst_hover(lowest)
    return FloorContact(
        penetration_m=float(max(-lowest.min(), 0)),
        sliding_m_s=float(np.concatenate(speeds).mean()) if np.concatenate(speeds).size else 0.0,
        hover_s=hover,
        flight_s=flight,
    )


def _worst_hover(lowest: np.ndarray) -> tuple[float, float]:
    """Duration of the hover that is longest for its height, and that of a flight so high."""
    runs, number = label(lowest > HOVER_M)
    worst = (0.0, 0.0)
    for run in range(1, number + 1):
        height = lowest[runs == run]
        found = len(height) / FPS, float(2 * np.sqrt(2 * height.max() / GRAVITY_M_S2))
        if worst == (0.0, 0.0) or found[0] - found[1] > worst[0] - worst[1]:
            worst = found
    return worst


class Supports(NamedTuple):
    """When what touches the floor."""

    contact: np.ndarray  # (N, S) bool: bears weight, and stays where it is
    flight: np.ndarray  # (N,) bool: nothing does, and gravity alone acts


def patch_weights(height: np.ndarray) -> np.ndarray:
    """(N, K) shares of a segment's points (N, K) heights, by how low each is; rows sum to 1."""
    share = np.exp(np.maximum((height.min(axis=1, keepdims=True) - height) / PATCH_M, -40.0))
    return share / share.sum(axis=1, keepdims=True)


def pair_weights(height: np.ndarray) -> np.ndarray:
    """(N - 1, K) shares of a segment's points by how low each is in a frame and in the next."""
    both = (height[:-1] - height[:-1].min(1, keepdims=True)) + (
        height[1:] - height[1:].min(1, keepdims=True)
    )
    both -= both.min(axis=1, keepdims=True)
    share = np.exp(np.maximum(-both / PATCH_M, -40.0))
    return share / share.sum(axis=1, keepdims=True)


def find_supports(
    points: np.ndarray, groups: list[np.ndarray], mass_height: np.ndarray
) -> Supports:
    """Tell what bears the weight of a body that is roughly on the floor.

    Args:
        points: (N, K, 3) of its surface, metres.
        groups: ids of each segment's points; may be empty.
        mass_height: (N,) of its centre of mass, metres.
    """
    count = len(points)
    height = np.full((count, SEGMENTS), np.inf)
    speed = np.full((count, SEGMENTS), np.inf)
    for segment, ids in enumerate(groups):
        if len(ids):
            height[:, segment] = points[:, ids, 2].min(axis=1)
            speed[:, segment] = _patch_speed(points[:, ids])
    lowest = height.min(axis=1)
    flight = _flights(lowest, mass_height)
    above = height - np.maximum(lowest, _floor(lowest, flight))[:, None]
    contact = (above < _LOW_M) & (speed < _SLOW_M_S) & ~flight[:, None]
    run = np.ones((_MIN_FRAMES, 1), dtype=bool)
    contact = binary_closing(np.pad(contact, ((3, 3), (0, 0)), mode="edge"), run)[3:-3]
    contact &= ~flight[:, None]
    contact = binary_opening(np.pad(contact, ((3, 3), (0, 0)), mode="edge"), run)[3:-3]
    alone = ~contact.any(axis=1) & ~flight
    cost = above / _LOW_M + speed / _SLOW_M_S
    cost[:, ~np.isfinite(cost).all(axis=0)] = 1e6
    best = gaussian_filter1d(cost, 1.5, axis=0, mode="nearest").argmin(axis=1)
    contact[alone, best[alone]] = True
    return Supports(contact, flight)


def _floor(lowest: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """(N,) height of the floor under a body whose lowest point is at heights (N,)."""
    if flight.all():
        return np.full(len(lowest), lowest.min())
    frames = np.arange(len(lowest))
    floor = np.interp(frames, frames[~flight], lowest[~flight])
    return gaussian_filter1d(floor, _FLOOR_FRAMES, mode="nearest")


def _patch_speed(points: np.ndarray) -> np.ndarray:
    """(N,) horizontal speed in m/s of a segment's lowest patch, to the calmer side in time."""
    if len(points) == 1:
        return np.zeros(1)
    share = pair_weights(points[..., 2])
    step = np.einsum("nk,nka->na", share, np.diff(points[..., :2], axis=0))
    speed = np.linalg.norm(step, axis=1) * FPS
    return np.minimum(np.append(speed, np.inf), np.append(np.inf, speed))


def _flights(lowest: np.ndarray, mass_height: np.ndarray) -> np.ndarray:
    """(N,) bool: the body is off the floor and falls."""
    if len(lowest) < _MIN_FRAMES:
        return np.zeros(len(lowest), dtype=bool)
    fall = np.zeros(len(lowest))
    fall[1:-1] = np.diff(mass_height, 2) * FPS**2
    fall[[0, -1]] = fall[[1, -2]]
    fall = gaussian_filter1d(fall, 1.0, mode="nearest")
    above = lowest - minimum_filter1d(lowest, 2 * _FLIGHT_FRAMES + 1, mode="nearest")
    core = (above > _HIGH_M) | (above > _OFF_M) & (fall < _FALLING_M_S2)
    core = binary_closing(np.pad(core, 2), np.ones(3))[2:-2]
    runs, number = label(core)
    out = np.zeros(len(lowest), dtype=bool)
    for run in range(1, number + 1):
        frames = np.flatnonzero(runs == run)
        if fall[frames].mean() > _SINKING_M_S2:
            continue
        first, last = frames[[0, -1]]
        while first > 0 and _leaves(lowest, above, first - 1, first):
            first -= 1
        while last < len(lowest) - 1 and _leaves(lowest, above, last + 1, last):
            last += 1
        out[first : last + 1] = True
    return out


def _leaves(lowest: np.ndarray, above: np.ndarray, frame: int, flying: int) -> bool:
    """Whether the body has left the floor in a frame beside one in which it flies."""
    return above[frame] > _LEFT_M and lowest[flying] - lowest[frame] > _LEAVING_M


def whole_flights(flight: np.ndarray) -> list[np.ndarray]:
    """Frames of each flight of which take-off and landing are seen."""
    runs, number = label(flight)
    flights = [np.flatnonzero(runs == run) for run in range(1, number + 1)]
    return [frames for frames in flights if frames[0] > 0 and frames[-1] < len(flight) - 1]


def neighbours_of(contact: np.ndarray) -> np.ndarray:
    """(N, S) bool: a segment or one that it is joined to is in contact."""
    near = contact.copy()
    for joint in range(1, SEGMENTS):
        near[:, joint] |= contact[:, PARENTS[joint]]
        near[:, PARENTS[joint]] |= contact[:, joint]
    return near


def frames_away(contact: np.ndarray, most: int) -> np.ndarray:
    """(N, S) how many frames it is to the closest one with contact, at most `most`."""
    away = np.full(contact.shape, most)
    near = contact
    for distance in range(most):
        away[near & (away == most)] = distance
        near = binary_dilation(near, np.ones((3, 1)))
    return away
