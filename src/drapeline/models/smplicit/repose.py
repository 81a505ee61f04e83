"""Garments at rest carried through poses by the wearer's skinning (SMPLicit 3.5).

The paper's network of pose-dependent wrinkles is left out: this is the skinning after it.
"""

import numpy as np
from scipy.spatial import cKDTree

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms
from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.skinning import skin_points, unskin_points
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.collision import Solid
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.smoothing import averaging_matrix

SKINNINGS = ("nearest", "smoothed")


def garment_weights(
    garment: Mesh, body: BodyModel, shape: np.ndarray, skinning: str = "nearest"
) -> np.ndarray:
    """Skinning weights (V, 24) of a garment at rest, rows sum to 1.

    Args:
        garment: in the rest pose, the root joint at the origin, metres.
        body: of the wearer.
        shape: (10,) of the wearer.
        skinning: "nearest", each vertex moves with the body's nearest vertex, as in the paper; or
            "smoothed", with many around it, smoothed over the cloth, so that a skirt does not tear
            between the legs.

    Raises:
        InputError: there is no such skinning.
    """
    if skinning not in SKINNINGS:
        raise InputError(f"skinning: '{skinning}', expected one of {', '.join(SKINNINGS)}")
    at_rest = rest_body(body, shape)
    if skinning == "smoothed":
        return interpolated_weights(garment.vertices, garment.faces, at_rest, body.weights)
    _, nearest = cKDTree(at_rest).query(garment.vertices)
    return body.weights[nearest]


def repose(
    garment: Mesh,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    *,
    skinning: str = "nearest",
    push_out: bool = False,
) -> np.ndarray:
    """A garment at rest in other poses; pose blend shapes of the body do not move it.

    Args:
        garment: triangles in the rest pose, the root joint at the origin, metres.
        body: of the wearer.
        shape: (10,) of the wearer.
        poses: (N, 72) axis-angle, rad.
        skinning: see `garment_weights`.
        push_out: whether vertices inside the posed body are moved out of it.

    Returns:
        (N, V, 3) float32 metres, the root joint at the origin.

    Raises:
        InputError: there is no such skinning, or poses are not (N, 72).
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] != 72:
        raise InputError(f"poses: shape {poses.shape}, expected (frames, 72)")
    weights = garment_weights(garment, body, shape, skinning)
    moved = _skin(garment.vertices, weights, body, shape, poses).astype(np.float32)
    if not push_out or not len(poses):
        return moved
    average = averaging_matrix(garment.faces, len(garment.vertices))
    bodies, _ = posed_vertices(body, shape, poses)
    solid = Solid(bodies[0], body.faces)
    for frame, points in enumerate(bodies):
        solid.move(points)
        moved[frame] = solid.push_out(moved[frame], average)
    return moved


def _skin(
    points: np.ndarray, weights: np.ndarray, body: BodyModel, shape: np.ndarray, poses: np.ndarray
) -> np.ndarray:
    """(N, V, 3) points at rest by way of the T-pose, which takes a body's vertex along exactly.

    Blending the joints' motions from the rest pose itself would be off by millimetres to a
    centimetre where several joints have a part.
    """
    _, joints = shape_body(body, shape)
    rotations = axis_angle_to_matrix(np.concatenate([REST_POSE[None], poses]).reshape(-1, 24, 3))
    motions, _ = joint_transforms((joints - joints[0]).astype(np.float64), rotations)
    straight = unskin_points(points[None], motions[:1], weights)[0]
    return skin_points(straight, motions[1:], weights)
