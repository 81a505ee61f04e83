"""Fit a motion to a body, by inverse kinematics of all frames together.

What supports the body is found in its motion (`contact.find_supports`). Then small rotations of the
joints and a change of the root's path are sought such that supports are on the floor z = 0 and do
not slide, nothing else is below it, the centre of mass falls freely in flights, and limbs keep
clear of the trunk and of each other; the changes are small and smooth in time. This is a space-time
optimisation (M. Gleicher, Retargetting motion to new characters, SIGGRAPH 1998), solved by
Gauss-Newton steps whose normal equations are banded in time.

N frames at 30 fps, K points of the body's surface, S = 24 segments, U unknowns of a frame.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.contact import (
    GRAVITY_M_S2,
    MASS_SHARES,
    SEGMENTS,
    Supports,
    find_supports,
    frames_away,
    neighbours_of,
    pair_weights,
    patch_weights,
    whole_flights,
)
from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms, pose_feature
from drapeline.bodies.model import BodyModel, shape_body
from drapeline.frames import FPS, JOINT_NAMES, PARENTS
from drapeline.geometry.mesh import vertex_normals

_LOOSENESS = (16, 8, 4, 4, 2, 2, 1, 1, 1, 1, 1, 1)  # of the conditions, step by step
_CELL_M = 0.012  # of the surface, one point each
_REACH_M = 0.15  # points that are never so near to the lowest one are left out
_SUNK_M = 0.001  # how far the patch that bears weight is pressed into the floor
_CLEAR_M = 0.016  # height of what passes over the floor,
_CLEAR_STEP_M = 0.012  # but only so much for every frame that it is away from its contact
_TUCKED = 0.7  # of the way that the body flies, its lowest point does at least
_LIMB_CELL_M = 0.03
_ROOT_SHARE = 0.4  # of upper arms, thighs and shins, which may lie against what they are joined to
_LIMB_DEPTH_M = 0.01  # limbs may be so deep in the rest of the body, which yields
_ALIGNED = 0.8  # cosine of the angle between normal and way out
_LIMB_STEP_M = 0.05  # and are not moved further in one step
_LOOK_STEPS = 5  # after so many steps it is seen anew which points are closest in all frames,
_CLOSE_M = 0.02  # and after each step in those where some are so close,
_ASIDE_M = 0.06  # but not for points that were so far from all others
# Standard deviations of the least squares.
_HEIGHT_M = 0.001
_PULL_M = 0.004  # of supports that are higher than another
_LIMB_M = 0.006
_SLIP_M = 0.0005  # per frame
_FALL_M = 0.03 * GRAVITY_M_S2 / FPS**2  # per frame and frame
_LIMIT_RAD = 0.01
_SMOOTH = 0.06  # of a change, per frame and frame, as a share of the change itself
_PATH_M = 1.0  # change of the root's path
_PATH_SPEED_M = 0.010  # its change per frame
_PATH_FORCE_M = 0.003  # per frame and frame

# Change of a joint's rotation about the axes of its parent, rad.
_TURNS = {
    "pelvis": (0.06, 0.06, 0.06),
    "spine1": (0.06, 0.06, 0.06),
    "spine2": (0.06, 0.06, 0.06),
    "spine3": (0.06, 0.06, 0.06),
    "hip": (0.3, 0.2, 0.3),
    "knee": (0.3, 0.02, 0.02),
    "ankle": (0.25, 0.1, 0.2),
    "shoulder": (0.2, 0.3, 0.3),
    "elbow": (0.1, 0.3, 0.02),
    "wrist": (0.1, 0.1, 0.25),
}
# Hinges flex about an axis of their parent; never less than this, if they do so in the motion.
_HINGES = {"left_knee": (0, 1), "right_knee": (0, 1), "left_elbow": (1, -1), "right_elbow": (1, 1)}
_LEAST_FLEXION_RAD = 0.03


def _part(name: str) -> str:
    return name.split("_")[-1]


_COLUMNS = np.array(
    [3 * joint + axis for joint, name in enumerate(JOINT_NAMES) if _part(name) in _TURNS
     for axis in range(3)]
)  # fmt: skip
_TURN_SIZES = np.array([_TURNS[_part(JOINT_NAMES[column // 3])][column % 3] for column in _COLUMNS])
# Keeps a step from turning joints by much more than this, rad: the equations are linear ones.
_DAMPING = np.concatenate([np.full(len(_COLUMNS), 1 / 0.03**2), np.zeros(3)])
_PATH = slice(len(_COLUMNS), len(_COLUMNS) + 3)
_UNKNOWNS = len(_COLUMNS) + 3

# Segments that stand as one: weight moves from heel to toes, and a foot may turn on the spot.
_PATCHES = [
    [JOINT_NAMES.index(f"{side}_{part}") for part in parts]
    for parts in (("ankle", "foot"), ("wrist", "hand"))
    for side in ("left", "right")
]
_PATCHES += [[one] for one in range(SEGMENTS) if not any(one in patch for patch in _PATCHES)]


# What keeps clear of what, for each side and its other one.
_ARM = ("shoulder", "elbow", "wrist", "hand")
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
_LEGS = ("left_hip", "left_knee", "right_hip", "right_knee")
_APART = [
    ([f"{side}_{part}" for side in ("left", "right") for part in _ARM], (*_TRUNK, *_LEGS)),
    (["left_hip", "right_hip"], _TRUNK[1:4]),
    (["left_hip", "left_knee"], ("right_hip", "right_knee")),
    (["right_hip", "right_knee"], ("left_hip", "left_knee")),
    (["left_knee", "left_ankle"], ("left_hip",)),
    (["right_knee", "right_ankle"], ("right_hip",)),
]
# Joined to the others; far end.
_ROOTS = {"shoulder": ("shoulder", "elbow"), "hip": ("hip", "knee"), "knee": ("knee", "ankle")}


def _above() -> np.ndarray:
    """(24, 24) whether the first joint is the second one or moves it."""
    below = np.eye(SEGMENTS)
    for joint in range(1, SEGMENTS):
        below[:, joint] += below[:, PARENTS[joint]]
    return below


_ABOVE = _above()


class _Pose(NamedTuple):
    """A skeleton in motion."""

    transforms: np.ndarray  # (N, 24, 3, 4) of the joints' frames from rest to the world
    joints: np.ndarray  # (N, 24, 3) metres
    parents: np.ndarray  # (N, 24, 3, 3) rotations of the joints' parents


def _pose(joints: np.ndarray, rotations: np.ndarray, path: np.ndarray) -> _Pose:
    transforms, places = joint_transforms(joints, rotations)
    transforms[..., 3] += path[:, None]
    parents = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(path), 1, 3, 3)), transforms[:, PARENTS[1:], :, :3]],
        axis=1,
    )
    return _Pose(transforms, places + path[:, None], parents)


def _rows(pose: _Pose, moments: np.ndarray, axes: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of skinned points, and their derivatives.

    Args:
        moments: (N, P, 24, 4) of each joint: the sum of weight times homogeneous place at rest.
        axes: of the world.

    Returns:
        (N, P, A) metres and (N, P, A, U).
    """
    parts = (pose.transforms[:, None] @ moments[..., None])[..., 0]  # (N, P, 24, 3)
    points = parts.sum(axis=2)
    arms = _ABOVE @ parts - (moments[..., 3] @ _ABOVE.T)[..., None] * pose.joints[:, None]
    slopes = np.zeros((*points.shape[:2], len(axes), _UNKNOWNS))
    turned = np.swapaxes(pose.parents, -1, -2)[:, None]  # world to parent
    for row, axis in enumerate(axes):
        torque = np.cross(arms, np.eye(3)[axis])
        local = (turned @ torque[..., None])[..., 0]
        slopes[:, :, row, : _PATH.start] = local.reshape(*points.shape[:2], -1)[..., _COLUMNS]
        slopes[:, :, row, _PATH.start + axis] = 1
    return points[..., list(axes)], slopes


class _Points:
    """Points of a shaped body's surface."""

    def __init__(self, body: BodyModel, places: np.ndarray, ids: np.ndarray) -> None:
        self.segments = body.segmentation[ids]
        self.weights = body.weights[ids].astype(np.float64)  # (K, 24)
        self.places = np.concatenate([places[ids], np.ones((len(ids), 1))], axis=1)  # (K, 4)
        self._directions = body.posedirs[ids] if body.has_posedirs else None

    def at_rest(self, rotations: np.ndarray) -> np.ndarray:
        """(N or 1, K, 4) homogeneous places at rest, moved by what poses change there."""
        if self._directions is None:
            return self.places[None]
        moved = np.einsum("nf,kaf->nka", pose_feature(rotations), self._directions)
        return self.places + np.pad(moved, ((0, 0), (0, 0), (0, 1)))

    def turns(self, pose: _Pose) -> np.ndarray:
        """(N, K, 3, 4) motions from rest to the world."""
        blended = self.weights @ pose.transforms.reshape(len(pose.joints), SEGMENTS, 12)
        return blended.reshape(*blended.shape[:2], 3, 4)

    def posed(self, pose: _Pose, places: np.ndarray) -> np.ndarray:
        """(N, K, 3) metres in the world."""
        return _move(self.turns(pose), places)

    def moments(self, places: np.ndarray, ids: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(N, 24, 4) moments of means of some points with shares (N, k)."""
        chosen = places[:, ids]
        return np.stack(
            [(share * chosen[..., axis]) @ self.weights[ids] for axis in range(4)], axis=-1
        )

    def spread_moments(self, places: np.ndarray, ids: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(N, 24, 4) moments of means of points (N, k), others in each frame."""
        rows = np.arange(len(ids))[:, None] if len(places) > 1 else 0
        weights = self.weights[ids] * share[..., None]  # (N, k, 24)
        return np.swapaxes(weights, 1, 2) @ places[rows, ids]


def _rotate(turns: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(N, K, 3) vectors after the linear part of motions (N, K, 3, 4)."""
    x, y, z = (vectors[..., axis, None] for axis in range(3))
    return turns[..., 0] * x + turns[..., 1] * y + turns[..., 2] * z


def _move(turns: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N, K, 3) homogeneous places (..., K, 4) after motions (N, K, 3, 4)."""
    return _rotate(turns, places) + turns[..., 3]


def _mass_moments(body: BodyModel, places: np.ndarray) -> np.ndarray:
    """(24, 4) moments of the centre of mass."""
    counts = np.bincount(body.segmentation, minlength=SEGMENTS)
    mass = (MASS_SHARES / np.maximum(counts, 1))[body.segmentation]
    whole = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    return (body.weights * (mass / mass.sum())[:, None]).T @ whole


def _thinned(body: BodyModel, cell_m: float) -> np.ndarray:
    """Vertices of the body, one for each cell of space."""
    cells = np.floor(body.v_template / cell_m).astype(np.int64)
    return np.unique(cells, axis=0, return_index=True)[1]


class _Shell(NamedTuple):
    """The body's surface in motion, thinned."""

    skin: _Points
    rest: np.ndarray  # (N or 1, K, 4) places at rest
    points: np.ndarray  # (N, K, 3) metres
    normals: np.ndarray  # (N, K, 3)


class _Limbs:
    """Parts of limbs that keep clear of other parts of the body."""

    def __init__(
        self, skin: _Points, joints: np.ndarray, limbs: Sequence[str], others: Sequence[str]
    ) -> None:
        own = np.isin(skin.segments, [JOINT_NAMES.index(name) for name in limbs])
        for name in limbs:
            if _part(name) in _ROOTS:  # the end that is joined to the others touches them
                joint = JOINT_NAMES.index(name)
                start = joints[joint]
                way = joints[JOINT_NAMES.index(name.replace(*_ROOTS[_part(name)]))] - start
                along = (skin.places[:, :3] - start) @ way / (way @ way)
                own &= (skin.segments != joint) | (along > _ROOT_SHARE)
        groups = [np.flatnonzero(own & (skin.segments == JOINT_NAMES.index(n))) for n in limbs]
        self._groups = [ids for ids in groups if len(ids)]
        self._limbs = np.concatenate(self._groups)
        wanted = [JOINT_NAMES.index(name) for name in others]
        self._others = np.flatnonzero(np.isin(skin.segments, wanted))
        self._near = np.zeros((0, 0), dtype=np.int64)  # (N, K) closest of the others
        self._distance = np.zeros((0, 0))  # (N, K) metres
        self._close = np.zeros(0, dtype=bool)  # (N,) some are about to meet, or have met

    def look(self, shell: _Shell, everywhere: bool) -> None:
        """See which points are closest to one another, in all frames or where some are close."""
        if everywhere:
            self._close = np.ones(len(shell.points), dtype=bool)
            self._distance = np.zeros((len(shell.points), len(self._limbs)))
            self._near = np.zeros(self._distance.shape, dtype=np.int64)
        for frame in np.flatnonzero(self._close):
            points = shell.points[frame]
            asked = np.flatnonzero(self._distance[frame] < _ASIDE_M)
            tree = KDTree(points[self._others], balanced_tree=False, compact_nodes=False)
            self._near[frame, asked] = self._others[tree.query(points[self._limbs[asked]])[1]]

    def add_to(self, system: "_Banded", pose: _Pose, shell: _Shell, loose: float) -> None:
        """Add how deep each part of the limbs is in the others, where it is deepest."""
        frames = np.flatnonzero(self._close)
        rows, near = frames[:, None], self._near[frames]
        outward = shell.normals[rows, near]  # (N', K, 3)
        offset = shell.points[rows, near] - shell.points[rows, self._limbs]
        depth = np.einsum("nka,nka->nk", offset, outward)
        distance = np.linalg.norm(offset, axis=2)
        # What is beside the rim of the others is not in them.
        depth[depth < _ALIGNED * distance] = 0
        self._distance[frames] = distance
        self._close[frames] = ((distance < _CLOSE_M) | (depth > 0)).any(axis=1)
        ends = np.cumsum([0, *(len(ids) for ids in self._groups)])
        parts = [slice(*ends) for ends in pairwise(ends)]
        excess = np.stack([depth[:, part].max(axis=1) for part in parts], axis=1) - _LIMB_DEPTH_M
        deep = np.flatnonzero((excess > 0).any(axis=1))
        if not len(deep):
            return
        frames, near, outward, depth, excess = (
            values[deep] for values in (frames, near, outward, depth, excess)
        )
        moments = np.zeros((2, *excess.shape, SEGMENTS, 4))
        directions = np.zeros((*excess.shape, 3))
        rest = shell.rest if len(shell.rest) == 1 else shell.rest[frames]
        for group, (ids, part) in enumerate(zip(self._groups, parts, strict=True)):
            share = patch_weights(-depth[:, part])
            moments[0, :, group] = shell.skin.moments(rest, ids, share)
            moments[1, :, group] = shell.skin.spread_moments(rest, near[:, part], share)
            directions[:, group] = np.einsum("nk,nka->na", share, outward[:, part])
        there = _Pose(*(values[frames] for values in pose))
        slopes = [_rows(there, part, (0, 1, 2))[1] for part in moments]
        slope = np.einsum("npau,npa->npu", slopes[1] - slopes[0], directions)
        weight = np.where(excess > 0, 1 / (loose * _LIMB_M) ** 2, 0)
        system.add([slope], np.clip(excess, 0, _LIMB_STEP_M), weight, frames)


class _Banded:
    """Normal equations of a chain of frames, of which any three in a row share residuals."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.blocks = [np.zeros((max(count - lag, 0), _UNKNOWNS, _UNKNOWNS)) for lag in range(3)]
        self.right = np.zeros((count, _UNKNOWNS))

    def add(
        self,
        slopes: list[np.ndarray],
        residual: np.ndarray,
        weight: np.ndarray,
        frames: np.ndarray | None = None,
    ) -> None:
        """Add squares of residuals (M, R) of M frames and those that follow each.

        Args:
            slopes: (M, R, U) by the unknowns of the frame, the next and so on.
            weight: (M, R) of the squares.
            frames: (M,) their numbers, each once; the first M if None.
        """
        weighted = [slope * weight[..., None] for slope in slopes]
        for first in range(len(slopes)):
            rows = slice(first, first + len(residual)) if frames is None else first + frames
            self.right[rows] += np.einsum("mru,mr->mu", weighted[first], residual)
            for second in range(first, len(slopes)):
                block = np.swapaxes(slopes[second], 1, 2) @ weighted[first]  # (M, later, earlier)
                self.blocks[second - first][rows] += block

    def add_prior(self, change: np.ndarray, sizes: np.ndarray, order: int) -> None:
        """Add squares of differences in time of the change (N, U) itself, over (U,) sizes."""
        taps = ([1], [-1, 1], [1, -2, 1])[order]
        weight = 1 / sizes**2
        total = self.count - order
        if total <= 0:
            return
        residual = np.diff(change, order, axis=0) * weight
        index = np.arange(_UNKNOWNS)
        for first, tap in enumerate(taps):
            self.right[first : first + total] += tap * residual
            for second in range(first, len(taps)):
                block = self.blocks[second - first]
                block[first : first + total, index, index] += tap * taps[second] * weight

    def step(self) -> np.ndarray:
        """(N, U) change that leads to the least sum."""
        size = _UNKNOWNS
        bands = np.zeros((3 * size, self.count * size))
        later, earlier = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
        for lag, block in enumerate(self.blocks):
            offset = lag * size + later - earlier
            valid = offset >= 0
            columns = bands.reshape(3 * size, self.count, size)
            columns[offset[valid], : len(block), earlier[valid]] = block[
                :, later[valid], earlier[valid]
            ].T
        bands[0] += np.tile(_DAMPING, self.count)
        solved = solveh_banded(bands, -self.right.ravel(), lower=True, overwrite_ab=True)
        return solved.reshape(self.count, size)


def fit_motion(
    body: BodyModel, shape: np.ndarray, poses: np.ndarray, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Supports]:
    """Poses and path of a body whose supports are on the floor and whose limbs are not in it.

    Args:
        shape: (10,).
        poses: (N, 72) axis-angle, rad.
        path: (N, 3) the root joint, metres, roughly above the floor.

    Returns:
        Poses (N, 72), path (N, 3), and what supports the body when.
    """
    fit = _Fit(body, shape, poses, path)
    for loose in _LOOSENESS:
        fit.step(loose)
    return fit.poses(), path + fit.change[:, _PATH], fit.supports


def lift_supports(vertices: np.ndarray, path: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """(N, 3) path with the lowest vertex on the floor, but for flights.

    Args:
        vertices: (N, V, 3) relative to the root joint, metres.
        path: (N, 3) the root joint, metres.
        flight: (N,) bool.
    """
    lifted = np.array(path)
    lifted[:, 2] += _lift(vertices[..., 2].min(axis=1) + path[:, 2], flight)
    return lifted


class _Fit:
    """The change (N, U) that fits a motion to a body, step by step."""

    def __init__(
        self, body: BodyModel, shape: np.ndarray, poses: np.ndarray, path: np.ndarray
    ) -> None:
        vertices, joints = (part.astype(np.float64) for part in shape_body(body, shape))
        self._joints, places = joints - joints[0], vertices - joints[0]
        axis_angle = np.asarray(poses, dtype=np.float64).reshape(-1, SEGMENTS, 3)
        self._first, self._path = axis_angle_to_matrix(axis_angle), path
        pose = _pose(self._joints, self._first, path)
        ids = _thinned(body, _CELL_M)
        low = _Points(body, places, ids)
        height = low.posed(pose, low.at_rest(self._first))[..., 2]
        reach = (height < height.min(axis=1, keepdims=True) + _REACH_M).any(axis=0)
        self._skin = _Points(body, places, ids[reach])
        shell = _thinned(body, _LIMB_CELL_M)
        self._shell = _Points(body, places, shell)
        self._normals = vertex_normals(places, body.faces)[shell]
        self._limbs = [_Limbs(self._shell, self._joints, *pair) for pair in _APART]
        self._taken = 0
        segments = self._skin.segments
        self._groups = [np.flatnonzero(segments == segment) for segment in range(SEGMENTS)]
        self._mass = np.broadcast_to(_mass_moments(body, places), (len(path), 1, SEGMENTS, 4))
        points = self._skin.posed(pose, self._skin.at_rest(self._first))
        mass_height = _rows(pose, self._mass, (2,))[0][:, 0, 0]
        self.supports = find_supports(points, self._groups, mass_height)
        self._clear = _clearance(self.supports)
        self._pressing = self.supports.contact
        self._flexion = _flexions(axis_angle)
        self.change = np.zeros((len(path), _UNKNOWNS))
        self.change[:, _PATH.stop - 1] = _lift(points[..., 2].min(axis=1), self.supports.flight)

    def _rotations(self) -> np.ndarray:
        """(N, 24, 3, 3) of each joint against its parent."""
        turns = np.zeros((len(self.change), 3 * SEGMENTS))
        turns[:, _COLUMNS] = self.change[:, : _PATH.start]
        return axis_angle_to_matrix(turns.reshape(-1, SEGMENTS, 3)) @ self._first

    def poses(self) -> np.ndarray:
        """(N, 72) axis-angle, rad."""
        rotations = self._rotations().reshape(-1, 3, 3)
        return Rotation.from_matrix(rotations).as_rotvec().reshape(-1, 3 * SEGMENTS)

    def step(self, loose: float) -> None:
        """One Gauss-Newton step, with conditions that are so many times looser."""
        rotations = self._rotations()
        pose = _pose(self._joints, rotations, self._path + self.change[:, _PATH])
        places = self._skin.at_rest(rotations)
        points = self._skin.posed(pose, places)
        system = _Banded(len(pose.joints))
        _add_priors(system, self.change)
        _add_limits(system, self.change, self._flexion)
        rest, turns = self._shell.at_rest(rotations), self._shell.turns(pose)
        shell = _Shell(self._shell, rest, _move(turns, rest), _rotate(turns, self._normals))
        for limbs in self._limbs:
            limbs.look(shell, everywhere=self._taken % _LOOK_STEPS == 0)
            limbs.add_to(system, pose, shell, loose)
        self._taken += 1
        lack, slopes = self._add_floor(system, pose, places, points, loose)
        if len(points) > 1:
            self._add_standing(system, pose, places, points, loose)
        if len(points) > 2:
            _add_flights(system, pose, self._mass, self.supports.flight)
        step = system.step()
        self.change += step
        # What would be pulled down to the floor is let go.
        left = lack + np.einsum("nsu,nu->ns", slopes, step)
        self._pressing = self.supports.contact | ((lack < 0) | self._pressing) & (left < 0)

    def _add_floor(
        self,
        system: "_Banded",
        pose: _Pose,
        places: np.ndarray,
        points: np.ndarray,
        loose: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Supports are on the floor, and nothing is below it.

        Returns:
            By how much segments are higher than they must be (N, S), and its slopes (N, S, U).
        """
        lack = np.full(self._clear.shape, np.inf)
        moments = np.zeros((*lack.shape, SEGMENTS, 4))
        for segment, ids in enumerate(self._groups):
            if len(ids):
                height = points[:, ids, 2]
                lack[:, segment] = height.min(axis=1) - self._clear[:, segment]
                moments[:, segment] = self._skin.moments(places, ids, patch_weights(height))
        slopes = _rows(pose, moments, (2,))[1][:, :, 0]
        active = self._pressing | (lack < 0)
        standing = np.where(self.supports.contact, lack, np.inf)
        lowest = np.isfinite(standing) & (standing == standing.min(axis=1, keepdims=True))
        size = loose * np.where((lack < 0) | lowest, _HEIGHT_M, _PULL_M)
        system.add([slopes], np.where(active, lack, 0), np.where(active, 1 / size**2, 0))
        return lack, slopes

    def _add_standing(
        self,
        system: "_Banded",
        pose: _Pose,
        places: np.ndarray,
        points: np.ndarray,
        loose: float,
    ) -> None:
        """Supports stay where they are."""
        for patch in _PATCHES:
            standing = self.supports.contact[:, patch].any(axis=1)
            both = standing[1:] & standing[:-1]
            if not both.any():
                continue
            ids = np.concatenate([self._groups[segment] for segment in patch])
            share = pair_weights(points[:, ids, 2])
            ends, slopes = [], []
            for rows in (slice(0, -1), slice(1, None)):
                part = _Pose(*(values[rows] for values in pose))
                rest = places if len(places) == 1 else places[rows]
                place, slope = _rows(part, self._skin.moments(rest, ids, share)[:, None], (0, 1))
                ends.append(place[:, 0])
                slopes.append(slope[:, 0])
            weight = np.repeat(both[:, None], 2, axis=1) / (loose * _SLIP_M) ** 2
            system.add([-slopes[0], slopes[1]], ends[1] - ends[0], weight)


def _lift(lowest: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """(N,) how much to lift the body so that it is roughly on the floor."""
    frames = np.arange(len(lowest))
    if flight.all():
        return np.full(len(lowest), -lowest.min())
    lift = np.interp(frames, frames[~flight], -lowest[~flight])
    return gaussian_filter1d(lift, 1.0, mode="nearest")


def _clearance(supports: Supports) -> np.ndarray:
    """(N, S) least height of each segment, metres."""
    near = neighbours_of(supports.contact)
    clear = np.minimum(_CLEAR_M, _CLEAR_STEP_M * frames_away(near, 3))
    clear[supports.contact] = -_SUNK_M
    for frames in whole_flights(supports.flight):
        passed = np.arange(1, len(frames) + 1)
        rise = GRAVITY_M_S2 / 2 / FPS**2 * passed * passed[::-1]
        clear[frames] = np.maximum(clear[frames], _TUCKED * rise[:, None])
    return clear


def _flexions(axis_angle: np.ndarray) -> np.ndarray:
    """(N, 4) flexion of the hinges, rad, by rotation vectors (N, 24, 3)."""
    return np.stack(
        [s * axis_angle[:, JOINT_NAMES.index(name), axis] for name, (axis, s) in _HINGES.items()],
        axis=1,
    )


def _add_priors(system: _Banded, change: np.ndarray) -> None:
    path = np.ones(3)
    system.add_prior(change, np.concatenate([_TURN_SIZES, _PATH_M * path]), 0)
    fast = np.concatenate([np.full(len(_TURN_SIZES), np.inf), _PATH_SPEED_M * path])
    system.add_prior(change, fast, 1)
    system.add_prior(change, np.concatenate([_SMOOTH * _TURN_SIZES, _PATH_FORCE_M * path]), 2)


def _add_limits(system: _Banded, change: np.ndarray, flexion: np.ndarray) -> None:
    """Hinges are not bent the other way."""
    for hinge, (name, (axis, sign)) in enumerate(_HINGES.items()):
        column = np.flatnonzero(3 * JOINT_NAMES.index(name) + axis == _COLUMNS)[0]
        least = np.minimum(flexion[:, hinge], _LEAST_FLEXION_RAD)
        lack = flexion[:, hinge] + sign * change[:, column] - least
        weight = np.where(lack < 0, 1 / _LIMIT_RAD**2, 0)
        system.blocks[0][:, column, column] += weight
        system.right[:, column] += sign * weight * lack


def _add_flights(system: _Banded, pose: _Pose, mass: np.ndarray, flight: np.ndarray) -> None:
    """The centre of mass falls freely."""
    height, slopes = _rows(pose, mass, (2,))
    z, slope = height[:, :, 0], slopes[:, :, 0]
    residual = z[:-2] - 2 * z[1:-1] + z[2:] + GRAVITY_M_S2 / FPS**2
    weight = np.zeros(len(pose.joints))
    for frames in whole_flights(flight):
        weight[frames] = 1 / _FALL_M**2
    system.add([slope[:-2], -2 * slope[1:-1], slope[2:]], residual, weight[1:-1, None])
