"""Skinned points of a body and their derivatives by pose, place and shape.

A joint's rotation is changed by a small one, in the frame of its parent: R -> exp(d) R. A point x
that joint k moves then turns about the joint's place c_k, so dx/dd is a cross product, and nothing
has to be differentiated numerically. Derivatives of pose blend shapes are left out.

P points, V vertices, U = 85 unknowns: 24 small rotations, the root joint's place, 10 shape values.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms
from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.bodies.rest_body import SHAPES
from drapeline.frames import PARENTS, REST_POSE

TURNS, PLACE, SHAPE = slice(0, 72), slice(72, 75), slice(75, 75 + SHAPES)
UNKNOWNS = SHAPE.stop


class BodyState(NamedTuple):
    """Shape and place of a body."""

    rotations: np.ndarray  # (24, 3, 3) of each joint against its parent
    trans: np.ndarray  # (3,) the root joint, metres
    shape: np.ndarray  # (10,)

    @classmethod
    def of(cls, pose: np.ndarray, trans: np.ndarray, shape: np.ndarray) -> "BodyState":
        """Of SMPL's axis-angles (72,), rad."""
        rotations = axis_angle_to_matrix(np.asarray(pose, dtype=np.float64).reshape(24, 3))
        return cls(rotations, np.array(trans, dtype=float), np.array(shape, dtype=float))

    @property
    def pose(self) -> np.ndarray:
        """(72,) axis-angles, rad."""
        return Rotation.from_matrix(self.rotations).as_rotvec().ravel()

    def step(self, change: np.ndarray) -> "BodyState":
        """The state after a change (U,) of the unknowns."""
        turns = axis_angle_to_matrix(change[TURNS].reshape(24, 3))
        return BodyState(
            turns @ self.rotations, self.trans + change[PLACE], self.shape + change[SHAPE]
        )

    def turns_from(self, other: "BodyState") -> np.ndarray:
        """(72,) rotation vectors that lead from another state's rotations to these, rad."""
        apart = self.rotations @ other.rotations.swapaxes(1, 2)
        return Rotation.from_matrix(apart).as_rotvec().ravel()


class SkinPoints(NamedTuple):
    """Points of a body's surface, in SMPL's T-pose relative to the root joint."""

    places: np.ndarray  # (P, 3) metres
    weights: np.ndarray  # (P, 24) of skinning
    by_shape: np.ndarray  # (P, 3, 10) change of the places per unit of shape


class MovedBody:
    """A body in a state: `vertices` (V, 3), `joints` (24, 3) in metres, and their derivatives."""

    def __init__(self, model: BodyModel, state: BodyState) -> None:
        self.model, self.state = model, state
        posed, _ = posed_vertices(model, state.shape, state.pose[None], state.trans[None])
        self.vertices = posed[0].astype(np.float64)
        t_pose, joints = (part.astype(np.float64) for part in shape_body(model, state.shape))
        self._t_pose, self._rest_joints = t_pose - joints[0], joints - joints[0]
        by_shape = model.J_regressor.astype(np.float64) @ model.shapedirs.transpose(2, 0, 1)
        self._root_by_shape = by_shape[:, 0]  # (10, 3)
        rest_by_shape = by_shape - by_shape[:, :1]  # (10, 24, 3)
        motions, places = joint_transforms(self._rest_joints, state.rotations[None])
        self._turns, self.joints = motions[0, ..., :3], places[0] + state.trans
        # Joints are linear in shape: the chain of one deformation is that of a skeleton.
        moved = np.stack([_chain(self._turns, one) for one in rest_by_shape])
        self._joints_by_shape = moved.transpose(1, 2, 0)  # (24, 3, 10)
        skinned = np.einsum("jab,mjb->jam", self._turns, rest_by_shape)
        self._shift_by_shape = self._joints_by_shape - skinned
        self._parent_turns = np.concatenate([np.eye(3)[None], self._turns[PARENTS[1:]]])
        at_rest, _ = joint_transforms(
            self._rest_joints, axis_angle_to_matrix(REST_POSE.reshape(1, 24, 3))
        )
        self.rest_turns = self._turns @ at_rest[0, ..., :3].swapaxes(1, 2)

    def points_of_faces(self, faces: np.ndarray, weights: np.ndarray) -> SkinPoints:
        """Points on faces (P, 3) of vertex ids, by barycentric weights (P, 3)."""
        model = self.model
        return SkinPoints(
            np.einsum("pc,pca->pa", weights, self._t_pose[faces]),
            np.einsum("pc,pcj->pj", weights, model.weights[faces]),
            np.einsum("pc,pcam->pam", weights, model.shapedirs[faces]) - self._root_by_shape.T,
        )

    def points_of_vertices(self, ids: np.ndarray) -> SkinPoints:
        """The vertices (P,) themselves."""
        model = self.model
        by_shape = model.shapedirs[ids] - self._root_by_shape.T
        return SkinPoints(self._t_pose[ids], model.weights[ids].astype(np.float64), by_shape)

    def slopes(
        self, points: SkinPoints, along: np.ndarray, offsets: np.ndarray | None = None
    ) -> np.ndarray:
        """(P, U) derivatives of along . x for points x.

        Args:
            along: (P, 3), which may differ from point to point.
            offsets: (P, 3) in `REST_POSE`, of points that follow those of the surface and turn
                with them; the surface's own if None.
        """
        # Products of matrices are ten times as fast as sums over several indices by `einsum`.
        count, weights = len(along), points.weights
        parts = (points.places @ self._turns.reshape(72, 3).T).reshape(count, 24, 3)
        parts += self.joints - np.einsum("jba,ja->jb", self._turns, self._rest_joints)
        if offsets is not None:
            parts += (offsets @ self.rest_turns.reshape(72, 3).T).reshape(count, 24, 3)
        arms = _BELOW @ (weights[..., None] * parts)
        arms -= (weights @ _BELOW.T)[..., None] * self.joints
        torque = np.cross(arms, along[:, None])
        turns = (torque.swapaxes(0, 1) @ self._parent_turns).swapaxes(0, 1)
        blended = (weights @ self._turns.reshape(24, 9)).reshape(count, 3, 3)
        linear = np.einsum("pab,pa->pb", blended, along)
        shift = (weights @ self._shift_by_shape.reshape(24, -1)).reshape(count, 3, SHAPES)
        shape = np.einsum("pb,pbm->pm", linear, points.by_shape)
        shape += np.einsum("pam,pa->pm", shift, along)
        return np.concatenate([turns.reshape(count, 72), along, shape], axis=1)

    def joint_slopes(self) -> np.ndarray:
        """(72, U) derivatives of the posed joints' coordinates."""
        arms = _BELOW.T[..., None] * (self.joints[:, None] - self.joints)  # (24, k, 3)
        slopes = np.zeros((24, 3, UNKNOWNS))
        for axis in range(3):
            torque = np.cross(arms, np.eye(3)[axis])
            slopes[:, axis, TURNS] = np.einsum("jka,kab->jkb", torque, self._parent_turns).reshape(
                24, 72
            )
            slopes[:, axis, PLACE] = np.eye(3)[axis]
        slopes[..., SHAPE] = self._joints_by_shape
        return slopes.reshape(72, UNKNOWNS)


def _chain(turns: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(24, 3) places of joints (24, 3) at rest, for the world rotations (24, 3, 3) of a pose."""
    places = [joints[0]]
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        places.append(places[parent] + turns[parent] @ (joints[joint] - joints[parent]))
    return np.stack(places)


def _below() -> np.ndarray:
    """(24, 24) whether the second joint is the first one or moves with it."""
    below = np.eye(24)
    for joint in range(1, 24):
        below[:, joint] += below[:, PARENTS[joint]]
    return below


_BELOW = _below()
