"""Linear blend skinning (LBS), of whole bodies and of points with weights of their own.

Bodies are skinned in coordinate planes and in single precision, which is fastest for thousands of
vertices; these functions take NumPy's arrays and torch's tensors. Points are skinned one by one
and in double precision, so that `unskin_points` is the exact inverse of `skin_points`.
"""

import numpy as np

from drapeline.bodies.kinematics import (
    Array,
    array_module,
    axis_angle_to_matrix,
    identity_like,
    joint_transforms,
)


def skin_planes(planes: Array, transforms: Array, weights: Array) -> Array:
    """LBS in coordinate planes: one matrix product, then three multiply-adds.

    Args:
        planes: (3, V) or (N, 3, V) coordinates of the rest body.
        transforms: (N, 24, 3, 4) of `joint_transforms`.
        weights: (24, V), columns sum to 1.

    Returns:
        (N, 3, V) coordinates of the posed body.
    """
    xp = array_module(transforms)
    blended = xp.reshape(xp.moveaxis(transforms, 1, 3), (-1, 24)) @ weights
    blended = xp.reshape(blended, (-1, 3, 4, weights.shape[1]))
    out = blended[:, :, 3]
    for axis in range(3):
        out = out + blended[:, :, axis] * planes[..., axis, None, :]
    return out


def pose_feature(rotations: Array) -> Array:
    """What SMPL's pose blend shapes are multiplied by: R - I of every joint but the root.

    Args:
        rotations: (N, 24, 3, 3).

    Returns:
        (N, 207).
    """
    difference = rotations[:, 1:] - identity_like(rotations)
    return array_module(rotations).reshape(difference, (len(rotations), -1))


def skin_body(
    vertices: Array,
    joints: Array,
    weights: Array,
    poses: Array,
    posedirs: Array | None = None,
) -> tuple[Array, Array]:
    """Pose a body as SMPL does; differentiable in every argument where those are torch's.

    Args:
        vertices: (V, 3) shaped rest body.
        joints: (24, 3) its joints.
        weights: (V, 24), rows sum to 1.
        poses: (N, 72) axis-angle in radians.
        posedirs: (V, 3, 207) pose blend shapes, or None for a body without.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), the root joint where it is at rest.
    """
    xp = array_module(poses)
    rotations = axis_angle_to_matrix(xp.reshape(poses, (-1, 24, 3)))
    transforms, places = joint_transforms(joints, rotations)
    planes = vertices.T
    if posedirs is not None:
        moved = pose_feature(rotations) @ xp.reshape(posedirs, (-1, posedirs.shape[-1])).T
        planes = planes + xp.reshape(moved, (len(moved), -1, 3)).swapaxes(1, 2)  # (N, 3, V)
    posed = skin_planes(planes, transforms, weights.T)
    return posed.swapaxes(1, 2), places


def skin_points(points: np.ndarray, motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """LBS of points from the rest pose to poses.

    Args:
        points: (M, 3) or (N, M, 3) metres in rest.
        motions: (N, 24, 3, 4) of `rest_body.rest_to_pose`.
        weights: (M, 24), rows sum to 1.

    Returns:
        (N, M, 3) float64 metres, the root joint at the origin.
    """
    blended = _blend_motions(motions, weights)
    return (blended[..., :3] @ points[..., None])[..., 0] + blended[..., 3]


def unskin_points(points: np.ndarray, motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Posed points (N, M, 3) back to the rest pose: the exact inverse of `skin_points`."""
    blended = _blend_motions(motions, weights)
    return np.linalg.solve(blended[..., :3], (points - blended[..., 3])[..., None])[..., 0]


def _blend_motions(motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(N, M, 3, 4) motion of each point."""
    flat = weights.astype(np.float64) @ motions.reshape(len(motions), 24, 12)
    return flat.reshape(len(motions), len(weights), 3, 4)
