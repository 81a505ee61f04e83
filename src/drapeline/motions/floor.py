"""The floor: what touches it, how far feet slide on it, and the root's height above it.

Touching is measured on the reference skeleton with spheres at soles, hands, knees and so on, so
that crawling and rolling clips meet the floor too. A body of another build is set down again by
its own vertices later.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES
from drapeline.motions.motion import Motion, loop_to
from drapeline.motions.skeleton import (
    REFERENCE_LEG_LENGTH_M,
    poses_from_globals,
    reference_joints,
    rotation_between,
)

CONTACT_HEIGHT_M = 0.03  # a point this near the floor may be standing on it
CONTACT_SPEED_M_S = 0.4  # a faster point is not
REST_HEIGHT_M = 0.035  # a foot rests if it is no higher
REST_SPEED_M_S = 0.6  # and the points it stands on are no faster
MIN_REST_FRAMES = 3
_BEARING_M = 0.01  # sole points this near to the lowest one carry weight with it
_NEIGHBOURHOOD_S = 0.5  # a support is nearly the lowest that the body gets within this time
_NEIGHBOURHOOD_M = 0.06
_SMOOTH_S = 0.1
WRIST_RADIUS_M = 0.03
_LEFT_SPHERES = (  # joint, centre in metres in the T-pose relative to the joint, radius
    ("ankle", (0.0, -0.079, -0.050), 0.0),
    ("foot", (-0.030, -0.029, 0.0), 0.0),
    ("foot", (0.030, -0.029, 0.0), 0.0),
    ("foot", (0.0, -0.029, 0.055), 0.0),
    ("knee", (0.0, 0.0, 0.0), 0.055),
    ("hip", (-0.02, -0.02, -0.06), 0.085),
    ("elbow", (0.0, 0.0, -0.005), 0.04),
    ("wrist", (0.0, 0.0, 0.0), WRIST_RADIUS_M),
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
# A body does not rest on its fingers: they are laid down or bend when a hand leans on the floor.
_SUPPORTS = np.flatnonzero([not JOINT_NAMES[joint].endswith("hand") for joint in SPHERE_JOINTS])
SOLES = np.flatnonzero(SPHERE_RADII == 0.0)
_ON_THE_LEFT = np.array([JOINT_NAMES[joint].startswith("left") for joint in SPHERE_JOINTS[SOLES]])
SOLES_BY_SIDE = (SOLES[_ON_THE_LEFT], SOLES[~_ON_THE_LEFT])


@dataclass(frozen=True)
class FloorReport:
    """Contact of a motion with the floor z = 0, on the reference skeleton.

    Attributes:
        sliding_mm_per_frame: mean horizontal travel from one frame to the next of the points
            that a resting foot stands on.
        near_floor_mm_per_frame: the same of every sole point that is within 3 cm of the floor
            and not swinging; pivots and feet about to lift count here.
        resting: share of frames in which a foot rests, over both feet.
        penetration_mean_mm: mean depth of the lowest point below the floor, over all frames.
        penetration_max_mm: largest such depth.
        floating_mean_mm: mean height of the lowest point in frames where the body is supported.
        supported: share of frames in which something rests on the floor.
    """

    sliding_mm_per_frame: float
    near_floor_mm_per_frame: float
    resting: float
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
    near = low[1:] & low[:-1] & (travel * motion.fps < 4 * CONTACT_SPEED_M_S)
    resting, bearing_travel = sole_rests(motion)
    rested = np.linalg.norm(bearing_travel[:-1, :, :2], axis=-1)[resting[:-1] & resting[1:]]
    depth = np.maximum(-lowest, 0.0)
    supported = supported_frames(points, motion.fps)
    return FloorReport(
        sliding_mm_per_frame=_mean_mm(rested),
        near_floor_mm_per_frame=_mean_mm(travel[near]),
        resting=float(resting.mean()),
        penetration_mean_mm=_mean_mm(depth),
        penetration_max_mm=float(1e3 * depth.max()),
        floating_mean_mm=_mean_mm(np.maximum(lowest[supported], 0.0)),
        supported=float(supported.mean()),
    )


def _mean_mm(values: np.ndarray) -> float:
    return float(1e3 * values.mean()) if values.size else 0.0


def sole_rests(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """When each foot rests, and how the points it stands on travel.

    Returns:
        Resting (N, 2) bool for left and right, and the travel (N, 2, 3) in metres of the points
        that carry weight from each frame to the next, 0 in the last frame.
    """
    points = touch_points(motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m)
    resting = np.zeros((len(motion), 2), dtype=bool)
    travel = np.zeros((len(motion), 2, 3))
    for side, soles in enumerate(SOLES_BY_SIDE):
        sole = points[:, soles]
        height = sole[..., 2].min(1)
        bearing = sole[..., 2] < height[:, None] + _BEARING_M
        step = np.diff(sole, axis=0)
        both = bearing[:-1] & bearing[1:]
        both |= ~both.any(1, keepdims=True) & bearing[:-1]  # weight shifts from heel to toe
        travel[:-1, side] = (step * both[..., None]).sum(1) / both.sum(1)[:, None]
        speed = np.linalg.norm(travel[:, side, :2], axis=1) * motion.fps
        slow = speed < REST_SPEED_M_S
        slow[1:] &= slow[:-1] | (speed[1:] == 0)
        low = height < REST_HEIGHT_M
        # Gaps of a frame are closed, and rests of less than `MIN_REST_FRAMES` dropped.
        whole = minimum_filter1d(maximum_filter1d(low & slow, 3, mode="nearest"), 3, mode="nearest")
        kept = minimum_filter1d(whole, MIN_REST_FRAMES, mode="nearest")
        resting[:, side] = maximum_filter1d(kept, MIN_REST_FRAMES, mode="nearest")
    return resting, travel


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


def rest_supports(motion: Motion) -> Motion:
    """Raise or lower the root, smoothly in time, so that what supports the body is at z = 0.

    Between supports (flight) the correction is interpolated. A cyclic motion stays cyclic.
    """
    points = _points(motion)[:, _SUPPORTS]
    height = points[..., 2].min(1)
    supported = supported_frames(points, motion.fps)
    if not supported.any():
        return _raise_root(motion, np.full(len(motion), -height.min()))
    rounds = 1 if motion.cycle is None else 3
    height, supported = np.tile(height, rounds), np.tile(supported, rounds)
    frames = np.arange(len(height))
    lift = np.interp(frames, frames[supported], -height[supported])
    lift = gaussian_filter1d(lift, _SMOOTH_S * motion.fps, mode="nearest")
    return _raise_root(motion, lift)


def lift_out(motion: Motion) -> Motion:
    """Raise the root, smoothly in time, wherever something is below the floor."""
    sunk = np.maximum(-_points(motion)[..., 2].min(1), 0.0)
    sunk = np.tile(sunk, 1 if motion.cycle is None else 3)
    # A smooth bump at least as high as what it must lift: widen, then blur by less than that.
    width = max(round(_SMOOTH_S * motion.fps), 1)
    raised = maximum_filter1d(sunk, 4 * width + 1, mode="nearest")
    return _raise_root(motion, gaussian_filter1d(raised, width / 2, mode="nearest"))


def _raise_root(motion: Motion, lift: np.ndarray) -> Motion:
    """Add (N,) metres to the root's height; of three rounds of a cycle the middle one counts."""
    count = len(motion)
    trans = motion.trans.copy()
    trans[:, 2] += lift if len(lift) == count else lift[count : 2 * count]
    return replace(motion, trans=trans)


def _points(motion: Motion) -> np.ndarray:
    return touch_points(motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m)


MAX_SHIFT_M = 0.10  # a foot is not moved further than this from where it was captured
_CLEAR_BEND = 0.15  # sine of the flexion from which a knee's own plane is trusted
_MAX_REACH = 0.999  # of the leg's length; a leg is never pulled straighter than this


def lock_feet(motion: Motion) -> Motion:
    """Turn hips, knees and ankles so that resting feet neither slide nor float.

    A cyclic motion stays cyclic.
    """
    if motion.cycle is None:
        return _lock(motion)
    count = len(motion)
    # The middle of three rounds has neighbours on both sides, and its poses fit every round.
    rounds = _lock(loop_to(motion, 3 * count))
    middle = rounds.poses[count : 2 * count].reshape(-1, 24, 3)
    poses = motion.poses.reshape(-1, 24, 3).copy()
    poses[:, 1:] = middle[:, 1:]  # rotations below the root do not depend on where it is
    return replace(motion, poses=poses.reshape(-1, 72))


def _lock(motion: Motion) -> Motion:
    if len(motion) < 2 * MIN_REST_FRAMES:
        return motion
    joints, rotations = reference_joints(
        motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m
    )
    resting, travel = sole_rests(motion)
    points = touch_points(motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m)
    for side, (name, soles) in enumerate(zip(("left", "right"), SOLES_BY_SIDE, strict=True)):
        height = points[:, soles, 2].min(1)
        shift = _shift(resting[:, side], travel[:, side], height)
        _bend_leg(joints, rotations, name, shift)
    return replace(motion, poses=poses_from_globals(rotations))


def _shift(resting: np.ndarray, travel: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N, 3) displacement that stops a foot while it rests and puts it on the floor."""
    frames = np.arange(len(resting))
    if not resting.any():
        return np.zeros((len(resting), 3))
    shift = np.zeros((len(resting), 3))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], resting.astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        drift = np.concatenate([np.zeros((1, 3)), np.cumsum(travel[start : end - 1], axis=0)])
        shift[start:end] = drift.mean(0) - drift
    shift[:, 2] = -height
    known = frames[resting]
    blend = np.stack([np.interp(frames, known, shift[known, axis]) for axis in range(3)], axis=1)
    blend = _ease(blend, resting)
    blend[:, 2] = np.maximum(blend[:, 2], -height)  # a swinging foot is not pushed below the floor
    length = np.linalg.norm(blend, axis=1, keepdims=True)
    return blend * np.minimum(1.0, MAX_SHIFT_M / np.maximum(length, 1e-9))


def _ease(blend: np.ndarray, resting: np.ndarray) -> np.ndarray:
    """Replace straight lines between rests by an S-curve, so that feet do not start abruptly."""
    out = blend.copy()
    known = np.flatnonzero(resting)
    for start, end in pairwise(known):
        if end - start > 1:
            part = np.arange(end - start + 1) / (end - start)
            part = (part * part * (3 - 2 * part))[:, None]
            out[start : end + 1] = blend[start] + part * (blend[end] - blend[start])
    return out


def _bend_leg(joints: np.ndarray, rotations: np.ndarray, side: str, shift: np.ndarray) -> None:
    """Turn hip and knee so that the ankle moves by `shift`, in place; the foot keeps its turn."""
    hip, knee, ankle = (JOINT_NAMES.index(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
    for frame in np.flatnonzero(np.abs(shift).max(1) > 1e-7):
        start, bend, end = joints[frame, [hip, knee, ankle]]
        thigh, shin = bend - start, end - bend
        lengths = np.linalg.norm(thigh), np.linalg.norm(shin)
        target = end + shift[frame] - start
        longest = max(np.linalg.norm(end - start), _MAX_REACH * sum(lengths))
        reach = np.clip(np.linalg.norm(target), abs(lengths[0] - lengths[1]) + 1e-4, longest)
        hinge = _hinge(thigh, shin, rotations[frame, hip, :, 0])
        flexion = np.arctan2(np.cross(thigh, shin) @ hinge, thigh @ shin)
        # First the knee's hinge, then swing the bent leg onto the target.
        turn = _about(hinge, _flexion(*lengths, reach) - flexion)
        swing = rotation_between(thigh + turn @ shin, target)
        rotations[frame, hip] = swing @ rotations[frame, hip]
        rotations[frame, knee] = swing @ turn @ rotations[frame, knee]


def _hinge(thigh: np.ndarray, shin: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Axis (3,) about which the knee flexes: of the bend itself, or across a straight thigh.

    A leg that is captured straight, or a little beyond, must not be bent forward.
    """
    bend = np.cross(thigh, shin)
    if bend @ across > _CLEAR_BEND * np.linalg.norm(thigh) * np.linalg.norm(shin):
        return bend / np.linalg.norm(bend)
    along = thigh / np.linalg.norm(thigh)
    hinge = across - along * (across @ along)
    return hinge / np.linalg.norm(hinge)


def _flexion(thigh: np.floating, shin: np.floating, reach: np.floating) -> float:
    """Flexion of the knee in radians, 0 when straight, for a hip-to-ankle distance."""
    cosine = (reach**2 - thigh**2 - shin**2) / (2 * thigh * shin)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) about a direction."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


HAND_LENGTH_M = 0.20  # wrist to fingertips of the reference skeleton
MAX_BEND_RAD = np.radians(85.0)
_SMOOTH_FRAMES = 2
# A palm turned a little away from the floor still counts as leaning on it: otherwise an upright
# forearm would flip between bending the hand back and forth.
_PALM_SLACK = 0.3


def lay_hands(motion: Motion) -> Motion:
    """Bend wrists where fingertips would be below z = 0; wrists and arms stay where they are."""
    joints, rotations = reference_joints(
        motion.poses, motion.trans, leg_length_m=motion.reference_leg_length_m
    )
    size = motion.reference_leg_length_m / REFERENCE_LEG_LENGTH_M
    changed = False
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wrist, hand = JOINT_NAMES.index(f"{side}_wrist"), JOINT_NAMES.index(f"{side}_hand")
        along = rotations[:, wrist, :, 0] * sign
        back = rotations[:, wrist, :, 1]
        height = (joints[:, wrist, 2] / size - WRIST_RADIUS_M) / HAND_LENGTH_M
        bend = _needed_bend(along[:, 2], back[:, 2], np.maximum(height, 0.0))
        if not bend.any():
            continue
        changed = True
        bend = _smooth(bend, cyclic=motion.cycle is not None)
        turn = Rotation.from_rotvec(np.cross(along, back) * bend[:, None]).as_matrix()
        rotations[:, wrist] = turn @ rotations[:, wrist]
        rotations[:, hand] = turn @ rotations[:, hand]
    return replace(motion, poses=poses_from_globals(rotations)) if changed else motion


def _needed_bend(along_z: np.ndarray, back_z: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N,) radians towards the back of the hand, negative towards the palm, smallest that helps.

    Args:
        along_z: vertical part of the direction from wrist to fingertips.
        back_z: vertical part of the direction out of the back of the hand.
        height: of the wrist above the floor in hand lengths, at least 0.
    """
    # Bent by b, the hand's slope is cos(b) along_z + sin(b) back_z = reach cos(b - steepest).
    reach = np.maximum(np.hypot(along_z, back_z), 1e-9)
    steepest = np.arctan2(back_z, along_z)
    leaning = back_z > -_PALM_SLACK * np.abs(along_z)
    steepest = np.where(leaning & (steepest < 0), steepest + 2 * np.pi, steepest)
    limit = np.arccos(np.clip(-height / reach, -1.0, 1.0))
    bend = np.where(leaning, steepest - limit, steepest + limit)
    return np.where(along_z < -height, np.clip(bend, -MAX_BEND_RAD, MAX_BEND_RAD), 0.0)


def _smooth(bend: np.ndarray, *, cyclic: bool) -> np.ndarray:
    """Ease in and out around the frames that need a bend, never less than they need."""
    mode = "wrap" if cyclic else "nearest"
    width = 4 * _SMOOTH_FRAMES + 1

    def widen(part: np.ndarray) -> np.ndarray:
        return gaussian_filter1d(
            maximum_filter1d(part, width, mode=mode), _SMOOTH_FRAMES, mode=mode
        )

    return widen(np.maximum(bend, 0.0)) - widen(np.maximum(-bend, 0.0))


def set_on_floor(motion: Motion, *, feet: bool = True, hands: bool = True) -> Motion:
    """Bring a motion to the floor z = 0 of the reference skeleton.

    The root is raised or lowered so that supports rest on the floor, then legs are bent so that
    resting feet neither slide nor float, wrists so that hands lie on the floor, and what is
    still below it (knees, elbows) is lifted out. A cyclic motion stays cyclic.

    Args:
        motion: a motion on any floor.
        feet: whether legs may be bent.
        hands: whether wrists may be bent.
    """
    motion = rest_supports(motion)
    if feet:
        motion = lock_feet(motion)
    if hands:
        motion = lay_hands(motion)
    return lift_out(motion)
