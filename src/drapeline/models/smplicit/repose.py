"""Garments at rest carried through poses by the wearer's skinning (SMPLicit 3.5).

What poses do to cloth beside that, P(p, theta, z_theta) there, is left out: learned networks gave
no more than a ridge regression, and both less than a simulation.
"""

import numpy as np
from scipy.spatial import cKDTree

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.rest_skinning import straighten, tpose_motions
from drapeline.bodies.skinning import skin_points
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.errors import InputError
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
    straight = straighten(garment.vertices, weights, body, shape)
    motions = tpose_motions(body, shape, poses)
    moved = skin_points(straight, motions, weights).astype(np.float32)
    if not push_out or not len(poses):
        return moved
    average = averaging_matrix(garment.faces, len(garment.vertices))
    bodies, _ = posed_vertices(body, shape, poses)
    solid = Solid(bodies[0], body.faces)
    for frame, points in enumerate(bodies):
        solid.move(points)
        moved[frame] = solid.push_out(moved[frame], average)
    return moved
