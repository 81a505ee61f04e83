"""The floor: what touches it, how far feet slide on it, and setting a motion down on it.

Touching is measured on the reference skeleton with spheres at soles, hands, knees and so on, so
that crawling and rolling clips meet the floor too. A body of another build is set down again by
its own vertices later.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from drapeline.frames import JOINT_NAMES
from drapeline.motions.motion import Motion
from drapeline.motions.skeleton import REFERENCE_LEG_LENGTH_M, reference_joints

CONTACT_HEIGHT_M = 0.03  # a point this near the floor may be standing on it
CONTACT_SPEED_M_S = 0.4  # a faster point is not
_NEIGHBOURHOOD_S = 0.5  # a support is nearly the lowest that the body gets within this time
_NEIGHBOURHOOD_M = 0.06
_SMOOTH_S = 0.1
_LEFT_SPHERES = (  # joint, centre in metres in the T-pose relative to the joint, radius
    ("ankle", (0.0, -0.079, -0.050), 0.0),
    ("foot", (-0.030, -0.029, 0.0), 0.0),
    ("foot", (0.030, -0.029, 0.0), 0.0),
    ("foot", (0.0, -0.029, 0.055), 0.0),
    ("knee", (0.0, 0.0, 0.0), 0.055),
    ("hip", (-0.02, -0.02, -0.06), 0.085),
    ("elbow", (0.0, 0.0, -0.005), 0.04),
    ("wrist", (0.0, 0.0, 0.0), 0.03),
    ("hand", (0.0, 0.0, 0.0), 0.02),
    ("hand", (0.085, 0.0, 0.0), 0.01),
    ("shoulder", (0.0, 0.0, 0.0), 0.06),
)
_MIDDLE_SPHERES = (
    ("spine1", (0.0, 0.0, 0.04), 0.12),
    ("spine3", (0.0, 0.05, 0.02), 0.12),
    ("head", (0.0, 0.065, 0.02), 0.09),
)


def _spheres() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    joints, centres, radii = [], [], []
    for part, (x, y, z), radius in _LEFT_SPHERES:
        for side, sign in (("left", 1.0), ("right", -1.0)):
            joints.append(JOINT_NAMES.index(f"{side}_{part}"))
            centres.append((sign * x, y, z))
            radii.append(radius)
    for part, centre, radius in _MIDDLE_SPHERES:
        joints.append(JOINT_NAMES.index(part))
        centres.append(centre)
        radii.append(radius)
    return np.array(joints), np.array(centres), np.array(radii)


SPHERE_JOINTS, SPHERE_CENTRES, SPHERE_RADII = _spheres()
SOLES = np.flatnonzero(SPHERE_RADII == 0.0)


@dataclass(frozen=True)
class FloorReport:
    """How well a motion stands on the floor z = 0, on the reference skeleton.

    Attributes:
        sliding_mm_per_frame: mean horizontal travel of a sole point from one frame to the next
            while it is on the floor in both.
        penetration_mean_mm: mean depth of the lowest point below the floor, over all frames.
        penetration_max_mm: largest such depth.
        floating_mean_mm: mean height of the lowest point in frames where the body is supported.
        supported: share of frames in which something rests on the floor.
    """

    sliding_mm_per_frame: float
    penetration_mean_mm: float
    penetration_max_mm: float
    floating_mean_mm: float
    supported: float


def touch_points(
    poses: np.ndarray, trans: np.ndarray, *, leg_length_m: float = REFERENCE_LEG_LENGTH_M
) -> np.ndarray:
    """(N, P, 3) lowest points of the reference skeleton's spheres in metres."""
    joints, rotations = reference_joints(poses, trans, leg_length_m=leg_length_m)
    size = leg_length_m / REFERENCE_LEG_LENGTH_M
    turned = np.einsum("njab,jb->nja", rotations[:, SPHERE_JOINTS], SPHERE_CENTRES * size)
    points = joints[:, SPHERE_JOINTS] + turned
    points[..., 2] -= SPHERE_RADII * size
    return points


def floor_report(motion: Motion) -> FloorReport:
    """Measure foot sliding, penetration and floating of a motion."""
    points = _points(motion)
    lowest = points[..., 2].min(1)
    soles = points[:, SOLES]
    low = soles[..., 2] < CONTACT_HEIGHT_M
    travel = np.linalg.norm(np.diff(soles[..., :2], axis=0), axis=-1)
    slow = travel * motion.fps < 4 * CONTACT_SPEED_M_S  # a swinging foot brushing by is no contact
    both = low[1:] & low[:-1] & slow
    depth = np.maximum(-lowest, 0.0)
    supported = supported_frames(points, motion.fps)
    return FloorReport(
        sliding_mm_per_frame=float(1e3 * travel[both].mean()) if both.any() else 0.0,
        penetration_mean_mm=float(1e3 * depth.mean()),
        penetration_max_mm=float(1e3 * depth.max()),
        floating_mean_mm=float(1e3 * np.maximum(lowest[supported], 0.0).mean())
        if supported.any()
        else 0.0,
        supported=float(supported.mean()),
    )


def supported_frames(points: np.ndarray, fps: float) -> np.ndarray:
    """(N,) bool: the lowest point rests, and is about as low as it gets around that time.

    The floor's height is not assumed, so that motions from any capture volume can be judged.
    """
    if len(points) == 1:
        return np.ones(1, dtype=bool)
    frames = np.arange(len(points))
    lowest = points[..., 2].argmin(1)
    speed = np.linalg.norm(np.gradient(points, 1.0 / fps, axis=0)[frames, lowest], axis=-1)
    height = points[frames, lowest, 2]
    width = 2 * round(_NEIGHBOURHOOD_S * fps) + 1
    around = minimum_filter1d(height, width, mode="nearest")
    return (speed < CONTACT_SPEED_M_S) & (height < around + _NEIGHBOURHOOD_M)


def set_on_floor(motion: Motion) -> Motion:
    """Raise or lower the root, smoothly in time, so that supports rest at z = 0.

    Between supports (flight) the correction is interpolated; where the result still dips below
    the floor it is lifted out. A cyclic motion stays cyclic.
    """
    points = _points(motion)
    count, rounds = len(points), 1
    if motion.cycle is not None:  # the correction has no seam either
        points, rounds = np.tile(points, (3, 1, 1)), 3
    height = points[..., 2].min(1)
    single = points[:count]
    supported = np.tile(supported_frames(single, motion.fps), rounds)
    frames = np.arange(len(height))
    if supported.any():
        lift = np.interp(frames, frames[supported], -height[supported])
        lift = gaussian_filter1d(lift, _SMOOTH_S * motion.fps, mode="nearest")
    else:
        lift = np.full(len(height), -height.min())
    sunk = np.maximum(-(height + lift), 0.0)
    if sunk.any():
        # A smooth bump at least as high as what it must lift: widen, then blur by as much.
        width = max(round(_SMOOTH_S * motion.fps), 1)
        raised = -minimum_filter1d(-sunk, 4 * width + 1, mode="nearest")
        lift = lift + gaussian_filter1d(raised, width / 2, mode="nearest")
    trans = motion.trans.copy()
    trans[:, 2] += lift[count : 2 * count] if rounds == 3 else lift
    return replace(motion, trans=trans)


def _points(motion: Motion) -> np.ndarray:
    return touch_points(motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m)
