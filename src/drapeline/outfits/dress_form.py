"""Dress forms: smooth, taut stand-ins for a body that garments are cut on.

A garment should show nothing of the anatomy under it. Every part of the body (torso, hips, arm,
leg) is therefore replaced by the convex hulls of its slices, like a tailor's dummy, and smoothed.
The form is kept in two ways: as radii around an axis, for garments that follow a limb, and as a
blurred signed distance field, for the places where limbs meet the torso.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    gaussian_filter1d,
    map_coordinates,
)
from scipy.spatial import ConvexHull, QhullError

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE

ANGLES = 96  # samples of every slice's outline
STEP_M = 0.01  # distance of slices
CELL_M = 0.01  # cells of the distance fields
BLUR_M = 0.018  # standard deviation of every smoothing
_HALF_SLICE_M = 0.009
Landmarks = dict[str, float]
_ARM = ("shoulder", "elbow", "wrist")
_TORSO = ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar")
_LEG = ("hip", "knee", "ankle")


@dataclass(frozen=True)
class Tube:
    """Outlines of a limb or torso around an axis, at equal steps of one coordinate."""

    start_m: float  # coordinate of the first slice; the next ones follow every `STEP_M`
    centre: np.ndarray  # (S, 2) centre of each slice
    # (S, ANGLES) distance of the outline from the centre, metres, at angles 2 pi k / ANGLES counted
    # from the second towards the first axis of the slice.
    radius: np.ndarray

    @property
    def stop_m(self) -> float:
        """Coordinate of the last slice."""
        return self.start_m + STEP_M * (len(self.radius) - 1)

    def radius_at(self, along_m: np.ndarray | float, angle: np.ndarray | float) -> np.ndarray:
        """Radius at coordinates `along_m` and angles (radians), broadcast together."""
        along_m, angle = np.broadcast_arrays(along_m, angle)
        rows = np.clip((along_m - self.start_m) / STEP_M, 0, len(self.radius) - 1)
        columns = np.asarray(angle) / (2 * np.pi) * ANGLES
        wrapped = np.concatenate([self.radius, self.radius[:, :1]], axis=1)
        return map_coordinates(wrapped, [rows, columns % ANGLES], order=1)

    def centre_at(self, along_m: np.ndarray | float) -> np.ndarray:
        """Centre (..., 2) at coordinates `along_m`."""
        knots = self.start_m + STEP_M * np.arange(len(self.centre))
        return np.stack([np.interp(along_m, knots, self.centre[:, k]) for k in (0, 1)], axis=-1)


@dataclass(frozen=True)
class Field:
    """Signed distance of a dress form, metres, negative inside: (X, Y, Z) float32.

    The centre of the first cell is at `origin` (3,) in the world.
    """

    origin: np.ndarray
    distance: np.ndarray

    @cached_property
    def _gradient(self) -> list[np.ndarray]:
        return np.gradient(self.distance, CELL_M)

    def _cells(self, points: np.ndarray) -> np.ndarray:
        return ((points - self.origin) / CELL_M).T

    def value(self, points: np.ndarray) -> np.ndarray:
        """Distance (P,) at points (P, 3); the nearest cell's outside the grid."""
        return map_coordinates(self.distance, self._cells(points), order=1, mode="nearest")

    def direction(self, points: np.ndarray) -> np.ndarray:
        """Unit gradient (P, 3), the way out of the form."""
        cells = self._cells(points)
        g = np.stack([map_coordinates(a, cells, order=1, mode="nearest") for a in self._gradient])
        return (g / np.maximum(np.linalg.norm(g, axis=0), 1e-6)).T

    def lift(self, points: np.ndarray, least_m: float | np.ndarray) -> np.ndarray:
        """Move points (P, 3) out along the gradient until they are at least `least_m` away."""
        points = points.copy()
        for _ in range(2):
            lack = least_m - self.value(points)
            low = lack > 0
            if not low.any():
                break
            points[low] += lack[low, None] * self.direction(points[low])
        return points

    def land(self, points: np.ndarray, level_m: float) -> np.ndarray:
        """Move points (P, 3) along the gradient onto the surface at distance `level_m`."""
        for _ in range(6):
            points = points + (level_m - self.value(points))[:, None] * self.direction(points)
        return points


@dataclass(frozen=True)
class DressForm:
    """One gender's dress form in rest pose at the mean shape, root-relative, Z up."""

    torso: Tube  # horizontal slices from the crotch to the neck, arms left off
    arm: Tube  # slices of the left arm along X
    leg: Tube  # horizontal slices of the left leg from the crotch down to the ankle
    skirt: Tube  # horizontal slices of hips and both legs together, from the ankles to the waist
    upper: Field  # field of torso and arms
    lower: Field  # field of hips and legs
    landmarks: Landmarks  # name -> metres (heights along Z, or X for the arm)


def build_dress_form(body: BodyModel) -> DressForm:
    """Make the dress form of a body's mean shape; takes a few seconds."""
    vertices, joints = (a[0] for a in posed_vertices(body, np.zeros(10), REST_POSE[None].copy()))
    points, part = _samples(vertices, body)
    joint = {name: joints[k] for k, name in enumerate(JOINT_NAMES)}
    marks = _landmarks(points, part, joint)
    torso = _torso(points, part, marks)
    arm = _arm(points, part, marks)
    leg = _leg(points, part, marks)
    return DressForm(
        torso,
        arm,
        leg,
        _skirt(points, part, marks, torso),
        _upper_field(torso, arm, marks),
        _lower_field(torso, leg, marks),
        marks,
    )


def _samples(vertices: np.ndarray, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """Dense symmetric surface points (P, 3) and the name of the part each belongs to."""
    corners = vertices[body.faces]
    mixes = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4], [1, 1, 0], [0, 1, 1], [1, 0, 1]])
    mixes = mixes / mixes.sum(axis=1, keepdims=True)
    points = np.einsum("mc,fcx->mfx", mixes, corners).reshape(-1, 3).astype(np.float64)
    names = np.array([name.removeprefix("left_").removeprefix("right_") for name in JOINT_NAMES])
    part = names[body.segmentation[body.faces[:, 0]]]
    part = np.tile(part, len(mixes))
    return np.concatenate([points, points * [-1, 1, 1]]), np.concatenate([part, part])


def _landmarks(points: np.ndarray, part: np.ndarray, joint: Mapping[str, np.ndarray]) -> Landmarks:
    x, z = np.abs(points[:, 0]), points[:, 2]
    shoulder, wrist = joint["left_shoulder"], joint["left_wrist"]
    trunk = np.isin(part, ["pelvis", "hip", "spine1"])
    crotch = z[trunk & (x < 0.012)].min()
    arm_part = np.isin(part, _ARM)
    near = arm_part & (np.abs(x - shoulder[0] - 0.055) < 0.012)
    ankle = joint["left_ankle"]
    return {
        "crotch": float(crotch),
        "hip": float(joint["left_hip"][2]),
        "hip_x": float(joint["left_hip"][0]),
        "waist": float(joint["spine1"][2]) * 0.6 + float(joint["spine2"][2]) * 0.4,
        "armpit": float(z[near].min() - 0.012),
        "shoulder_x": float(shoulder[0]),
        "shoulder": float(shoulder[2]),
        "neck": float(joint["neck"][2]),
        "wrist_x": float(wrist[0]),
        "elbow_x": float(joint["left_elbow"][0]),
        "knee": float(joint["left_knee"][2]),
        "ankle": float(ankle[2]),
        "ankle_x": float(ankle[0]),
    }


def _outlines(
    along: np.ndarray, plane: np.ndarray, start: float, stop: float, axis: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Hull outlines of points by slices: centres (S, 2) and radii (S, ANGLES), gaps filled.

    Args:
        along, plane: (P,) and (P, 2) coordinates of the points, along the axis and across it.
        start, stop: of the slices.
        axis: (2,) which radii count from, or None for the straight line through the slices'
            middles.
    """
    knots = start + STEP_M * np.arange(round((stop - start) / STEP_M) + 1)
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    rays = np.stack([np.sin(angle), np.cos(angle)])
    centre = np.full((len(knots), 2), np.nan)
    radius = np.full((len(knots), ANGLES), np.nan)
    if axis is None:
        line = np.polynomial.polynomial.polyfit(*_middles(along, plane, knots), 1)
        middle = np.polynomial.polynomial.polyval(knots, line).T
    else:
        middle = np.broadcast_to(axis, (len(knots), 2))
    order = np.argsort(along, kind="stable")
    along, plane = along[order], plane[order]
    for k, knot in enumerate(knots):
        low, high = np.searchsorted(along, [knot - _HALF_SLICE_M, knot + _HALF_SLICE_M])
        if high - low < 8:
            continue
        try:
            hull = ConvexHull(plane[low:high])
        except QhullError:
            continue
        centre[k] = middle[k]
        facing = hull.equations[:, :2] @ rays
        reach = -(hull.equations[:, :2] @ centre[k] + hull.equations[:, 2])[:, None]
        radius[k] = np.where(facing > 1e-9, reach / np.maximum(facing, 1e-9), np.inf).min(axis=0)
    good = np.isfinite(radius[:, 0])
    row = np.arange(len(knots))
    for table in (centre, radius):
        for column in range(table.shape[1]):
            table[:, column] = np.interp(row, row[good], table[good, column])
    # Outlines move with their centre: smooth both along the axis, radii around it as well.
    centre = gaussian_filter1d(centre, BLUR_M / STEP_M, axis=0, mode="nearest")
    radius = gaussian_filter1d(radius, BLUR_M / STEP_M, axis=0, mode="nearest")
    return centre, gaussian_filter1d(radius, ANGLES / 40, axis=1, mode="wrap")


def _middles(
    along: np.ndarray, plane: np.ndarray, knots: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Knots that have points, and the middle of their bounding box."""
    slices = [(k, plane[np.abs(along - k) < _HALF_SLICE_M]) for k in knots]
    middles = [(k, (p.min(axis=0) + p.max(axis=0)) / 2) for k, p in slices if len(p)]
    return np.array([k for k, _ in middles]), np.array([m for _, m in middles])


def _torso(points: np.ndarray, part: np.ndarray, marks: Landmarks) -> Tube:
    keep = np.isin(part, [*(n.removeprefix("left_").removeprefix("right_") for n in _TORSO)])
    keep |= (part == "hip") & (points[:, 2] > marks["crotch"] - 0.03)
    keep |= (part == "shoulder") & (np.abs(points[:, 0]) < marks["shoulder_x"])
    start, stop = marks["crotch"] - 0.02, marks["neck"] + 0.04
    trunk = points[keep & (points[:, 2] < marks["armpit"]), 1]
    # One straight axis: cloth that hangs keeps its distance from it.
    axis = np.array([0.0, (trunk.min() + trunk.max()) / 2])
    centre, radius = _outlines(points[keep, 2], points[keep, :2], start, stop, axis)
    return Tube(start, centre, _left_right_mean(radius))


def _skirt(points: np.ndarray, part: np.ndarray, marks: Landmarks, torso: Tube) -> Tube:
    keep = np.isin(part, ["pelvis", "spine1", "spine2", *_LEG])
    start, stop = marks["ankle"] - 0.02, marks["waist"] + 0.05
    centre, radius = _outlines(points[keep, 2], points[keep, :2], start, stop, torso.centre[0])
    return Tube(start, centre, _left_right_mean(radius))


def _left_right_mean(radius: np.ndarray) -> np.ndarray:
    return (radius + radius[:, -np.arange(ANGLES) % ANGLES]) / 2


def _arm(points: np.ndarray, part: np.ndarray, marks: Landmarks) -> Tube:
    keep = np.isin(part, _ARM) & (points[:, 0] > 0)
    start, stop = marks["shoulder_x"] + 0.02, marks["wrist_x"] + 0.01
    centre, radius = _outlines(points[keep, 0], points[keep, 1:], start, stop)
    return Tube(start, centre, radius)


def _leg(points: np.ndarray, part: np.ndarray, marks: Landmarks) -> Tube:
    keep = (points[:, 0] > 0) & (points[:, 2] < marks["crotch"] + 0.01)
    keep &= np.isin(part, ["pelvis", *_LEG])
    start, stop = marks["ankle"] - 0.02, marks["crotch"] - 0.01
    centre, radius = _outlines(points[keep, 2], points[keep, :2], start, stop)
    return Tube(start, centre, radius)


def _inside(tube: Tube, along: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Points of a grid, along (A,) times plane (B, 2), that lie within a tube: (A, B) bool."""
    shift = plane[None] - tube.centre_at(along)[:, None]
    angle = np.arctan2(shift[..., 0], shift[..., 1])
    within = np.hypot(shift[..., 0], shift[..., 1]) < tube.radius_at(along[:, None], angle)
    return within & ((along >= tube.start_m) & (along <= tube.stop_m))[:, None]


def _axes(low: Sequence[float], high: Sequence[float]) -> list[np.ndarray]:
    """Coordinates of a grid's cells along x, y and z, between two corners."""
    counts = np.ceil((np.array(high) - np.array(low)) / CELL_M).astype(int) + 1
    return [a + CELL_M * np.arange(n) for a, n in zip(low, counts, strict=True)]


def _field(solid: np.ndarray, axes: list[np.ndarray]) -> Field:
    outside = distance_transform_edt(~solid) * CELL_M
    inside = distance_transform_edt(solid) * CELL_M
    # Cell centres lie half a cell off the boundary on either side.
    distance = np.where(solid, CELL_M / 2 - inside, outside - CELL_M / 2)
    distance = gaussian_filter(np.clip(distance, -0.08, 0.3), BLUR_M / CELL_M)
    distance = (distance + distance[::-1]) / 2
    return Field(np.array([a[0] for a in axes]), distance.astype(np.float32))


def _symmetric(half_width: float) -> float:
    return CELL_M * (np.ceil(half_width / CELL_M) + 0.5)


def _upper_field(torso: Tube, arm: Tube, marks: Landmarks) -> Field:
    width = _symmetric(marks["wrist_x"] + 0.1)
    low = marks["armpit"] - 0.3
    axes = _axes([-width, -0.35, low], [width - CELL_M / 2, 0.35, torso.stop_m + 0.1])
    x, y, z = axes
    plane = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    solid = _inside(torso, z, plane).reshape(len(z), len(x), len(y)).transpose(1, 2, 0)
    plane = np.stack(np.meshgrid(y, z, indexing="ij"), -1).reshape(-1, 2)
    left = _inside(arm, x, plane).reshape(len(x), len(y), len(z))
    # Between torso and arm the shoulder is bridged by the arm's first slice.
    root = (x >= 0.6 * marks["shoulder_x"]) & (x <= arm.start_m)
    first = _inside(arm, np.array([arm.start_m]), plane).reshape(1, len(y), len(z))
    left = left | (root[:, None, None] & first)
    return _field(solid | left | left[::-1], axes)


def _lower_field(torso: Tube, leg: Tube, marks: Landmarks) -> Field:
    width = _symmetric(marks["ankle_x"] + 0.25)
    axes = _axes([-width, -0.4, leg.start_m - 0.08], [width - CELL_M / 2, 0.4, marks["armpit"]])
    x, y, z = axes
    plane = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    solid = _inside(torso, z, plane) | _inside(leg, z, plane)
    left = solid.reshape(len(z), len(x), len(y)).transpose(1, 2, 0)
    below = z < leg.start_m
    left[:, :, below] = left[:, :, [int(below.sum())]]
    return _field(left | left[::-1], axes)
