"""The body in a segmented scan or a sequence of them: pose, place and shape by least squares.

A single scan is fitted as in SMPLicit 4.2.

The paper minimises the Chamfer distance between scan and body, the distance between joints and
predicted ones, and a prior. The points of a segmented scan are known to be skin or cloth, so here
those of the skin are on the body and those of cloth are not inside it. The prior keeps the body
close to its first estimate, and its shape close to the mean.

Absolute distances are minimised as weighted squares, by damped Gauss-Newton steps.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.moved_body import PLACE, SHAPE, TURNS, UNKNOWNS, BodyState, MovedBody
from drapeline.bodies.settings import BodyFit
from drapeline.geometry.closest import closest_points
from drapeline.geometry.least_squares import LeastSquares, absolute_weights
from drapeline.geometry.mesh import barycentric, face_normals, vertex_normals

_REACH_M = 0.1  # skin further from the scan has not been seen
_GAP_M = 0.003  # cloth is this far off the skin
_FLOOR_M = 0.003  # below it, absolute distances are taken for squares
# Of the fit to a sequence.
_FITTED_FRAMES, _FITTED_POINTS, _FITTED_STEPS = 12, 400, 20
_FITTED_WEIGHT = 2e5  # of its points, by their mean absolute distance
_REACHES_M = 0.05, 0.003  # of points that may be cloth, from the first step to the last
_TURN_RAD, _SHAPE, _PLACE_M = 0.05, 0.5, 0.01  # how far it is from the estimate
_MEASURED_FRAMES, _EXACT_M, _SKIN_SHARE = 5, 0.001, 0.1


class BodyTerms:
    """Residuals of a body against a scan of it.

    Args:
        points: (P, 3) metres, in the world.
        skin: (P,) whether each is skin; all others are cloth.
        first: the first estimate.
        joints: (24, 3) predicted in the world, or None.
    """

    def __init__(
        self,
        points: np.ndarray,
        skin: np.ndarray,
        first: BodyState,
        joints: np.ndarray | None,
        settings: BodyFit,
        rng: np.random.Generator,
    ) -> None:
        self._first, self._joints, self._settings = first, joints, settings
        self._tree, self._is_skin, self._all = KDTree(points), skin, points.astype(np.float64)
        self._skin, self._cloth = (
            self._all[np.flatnonzero(part)][_some(int(part.sum()), settings.points, rng)]
            for part in (skin, ~skin)
        )
        self._rng = rng

    def add_to(self, equations: LeastSquares, body: MovedBody) -> None:
        """Add all terms for a body as it is now."""
        self.add_joints(equations, body)
        self._add_skin(equations, body)
        self._add_vertices(equations, body)
        self._add_cloth(equations, body)

    def add_joints(self, equations: LeastSquares, body: MovedBody) -> None:
        """Add the terms of joints, and the priors."""
        settings, state = self._settings, body.state
        if self._joints is not None:
            away = (body.joints - self._joints).ravel()
            equations.add(body.joint_slopes(), away, settings.joints_m**-2)
        turned = state.turns_from(self._first)
        equations.add_prior(TURNS, turned, settings.pose_rad**-2)
        equations.add_prior(SHAPE, state.shape, settings.shape**-2)
        equations.add_prior(PLACE, state.trans - self._first.trans, 1.0)

    def _add_skin(self, equations: LeastSquares, body: MovedBody) -> None:
        """Points of the skin are on the body."""
        if len(self._skin):
            place, normal, corners, share = _on_surface(self._skin, body)
            away = np.einsum("pi,pi->p", place - self._skin, normal)
            slopes = body.slopes(body.points_of_faces(corners, share), normal)
            equations.add(slopes, away, self._weights(away))

    def _add_vertices(self, equations: LeastSquares, body: MovedBody) -> None:
        """Vertices of the body next to skin of the scan are on it."""
        count = len(body.vertices)
        ids = _some(count, self._settings.points, self._rng)
        distance, near = self._tree.query(body.vertices[ids], distance_upper_bound=_REACH_M)
        seen = np.isfinite(distance)
        seen[seen] = self._is_skin[near[seen]]
        ids, near = ids[seen], near[seen]
        if len(ids):
            normal = vertex_normals(body.vertices, body.model.faces)[ids]
            away = np.einsum("pi,pi->p", body.vertices[ids] - self._all[near], normal)
            slopes = body.slopes(body.points_of_vertices(ids), normal)
            equations.add(slopes, away, self._weights(away))

    def _add_cloth(self, equations: LeastSquares, body: MovedBody) -> None:
        """The body is below the cloth."""
        if len(self._cloth):
            place, normal, corners, share = _on_surface(self._cloth, body)
            deep = np.einsum("pi,pi->p", place - self._cloth, normal) + _GAP_M
            below = deep > 0
            slopes = body.slopes(body.points_of_faces(corners[below], share[below]), normal[below])
            weights = self._weights(deep[below]) * below.mean()
            equations.add(slopes, deep[below], weights)

    def _weights(self, away: np.ndarray) -> np.ndarray:
        settings = self._settings
        total = settings.weight / settings.skin_m
        return total * absolute_weights(away, _FLOOR_M) / max(len(away), 1)


def fit_body(
    model: BodyModel,
    points: np.ndarray,
    skin: np.ndarray,
    first: BodyState,
    joints: np.ndarray | None,
    settings: BodyFit,
    rng: np.random.Generator,
) -> BodyState:
    """The body in a scan; see `BodyTerms` for the arguments."""
    terms, state = BodyTerms(points, skin, first, joints, settings, rng), first
    for add in [terms.add_joints] * settings.joint_steps + [terms.add_to] * settings.steps:
        equations = LeastSquares(UNKNOWNS)
        add(equations, MovedBody(model, state))
        state = state.step(equations.step())
    return state


class FittedSequence(NamedTuple):
    """A body through a sequence."""

    poses: np.ndarray  # (F, 72) rad
    shape: np.ndarray  # (10,)
    shift: np.ndarray  # (3,) of the root joint, metres


def fit_sequence(
    model: BodyModel,
    points: np.ndarray,
    skin: np.ndarray | None,
    poses: np.ndarray,
    shape: np.ndarray,
    rng: np.random.Generator,
) -> FittedSequence:
    """A body whose estimate is off in the same way in all frames.

    Every joint is turned by the same small rotation in the frame of its parent, as estimates of
    poses are off that come from one method, and as markers are off that sit on one person. Some
    points of some frames decide. Points of skin come to lie on the body, and cloth outside it.
    Where it is not known what is skin, points count the less the farther outside the body they
    are, and from step to step those far outside lose their say.

    Args:
        points: (F, P, 3) metres, relative to the root joint as estimated.
        skin: (F, P) whether each is skin, and cloth otherwise; None if that is not known.
        poses: (F, 72) estimated, rad.
        shape: (10,) estimated.
    """
    frames = _spread(len(poses), _FITTED_FRAMES)
    chosen = [_some(points.shape[1], _FITTED_POINTS, rng) for _ in frames]
    clouds = [points[f][some].astype(np.float64) for f, some in zip(frames, chosen, strict=True)]
    labels = [None if skin is None else skin[f][s] for f, s in zip(frames, chosen, strict=True)]
    first = [BodyState.of(poses[frame], np.zeros(3), shape) for frame in frames]
    states = first
    for reach_m in np.geomspace(*_REACHES_M, _FITTED_STEPS):
        equations = LeastSquares(UNKNOWNS)
        for cloud, is_skin, state in zip(clouds, labels, states, strict=True):
            body = MovedBody(model, state)
            place, normal, corners, share = _on_surface(cloud, body)
            height = np.einsum("pi,pi->p", cloud - place, normal)
            if is_skin is None:
                counted = (1 + (np.maximum(height, 0) / reach_m) ** 2) ** -2
            else:
                counted = (is_skin | (height < 0)).astype(float)
            slopes = body.slopes(body.points_of_faces(corners, share), normal)
            weights = counted * absolute_weights(height, _FLOOR_M) / len(cloud)
            equations.add(slopes, -height, _FITTED_WEIGHT * weights)
        begun, now = first[0], states[0]
        for part, away, deviation in (
            (TURNS, now.turns_from(begun), _TURN_RAD),
            (SHAPE, now.shape - begun.shape, _SHAPE),
            (PLACE, now.trans, _PLACE_M),
        ):
            equations.add_prior(part, away, len(frames) / deviation**2)
        change = equations.step()
        states = [state.step(change) for state in states]
    turned = axis_angle_to_matrix(states[0].turns_from(first[0]).reshape(24, 3))
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float64).reshape(-1, 24, 3))
    found = Rotation.from_matrix((turned @ rotations).reshape(-1, 3, 3)).as_rotvec()
    return FittedSequence(found.reshape(len(poses), 72), states[0].shape, states[0].trans)


def is_exact(model: BodyModel, points: np.ndarray, poses: np.ndarray, shape: np.ndarray) -> bool:
    """Whether the body of a sequence lies within its points as exactly as skin shows.

    Somewhere there is skin, and be it face and hands: a tenth of the points are within a
    millimetre of an exact body. See `fit_sequence` for the arguments.
    """
    near = []
    for frame in _spread(len(poses), _MEASURED_FRAMES):
        posed = posed_vertices(model, shape, poses[frame][None])[0][0]
        place, _ = closest_points(points[frame], posed, model.faces)
        near.append(np.linalg.norm(place - points[frame], axis=1) < _EXACT_M)
    return bool(np.mean(near) >= _SKIN_SHARE)


def _spread(count: int, wanted: int) -> np.ndarray:
    """Frames, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).round().astype(int))


def _on_surface(
    points: np.ndarray, body: MovedBody
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Closest places (P, 3) on a body, normals there, and the faces (P, 3) with weights (P, 3)."""
    faces = body.model.faces
    place, face = closest_points(points, body.vertices, faces)
    place = place.astype(np.float64)
    corners = faces[face]
    return (
        place,
        face_normals(body.vertices, corners),
        corners,
        barycentric(place, body.vertices[corners]),
    )


def _some(count: int, wanted: int, rng: np.random.Generator) -> np.ndarray:
    return rng.choice(count, min(count, wanted), replace=False)
