"""Kinematics and skinning of the SMPL skeleton, for NumPy's arrays and torch's tensors.

Skinning is linear blending (LBS). Bodies are skinned in coordinate planes and in single precision,
which is fastest for thousands of vertices. Points are skinned one by one and in double precision,
so that `unskin_points` is the exact inverse of `skin_points`.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from drapeline.frames import JOINT_NAMES, PARENTS

if TYPE_CHECKING:
    import torch

# Either will do; most jobs have plain arrays, and torch takes two seconds to import.
Array = TypeVar("Array", np.ndarray, "torch.Tensor")


def array_module(array: Array) -> ModuleType:
    """`numpy` or `torch`, for functions that both have under one name."""
    return np if isinstance(array, np.ndarray) else sys.modules["torch"]


def axis_angle_to_matrix(axis_angle: Array) -> Array:
    """Rotation vectors (..., 3) in rad to matrices (..., 3, 3), by Rodrigues' formula.

    Differentiable at zero.
    """
    xp = array_module(axis_angle)
    angle = xp.sqrt(xp.sum(axis_angle**2, axis=-1, keepdims=True) + 1e-24)
    axis = axis_angle / angle
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    zero = xp.zeros_like(x)
    cross = xp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    cross = xp.reshape(cross, (*axis_angle.shape[:-1], 3, 3))
    angle = angle[..., None]
    identity = identity_like(axis_angle)
    return identity + xp.sin(angle) * cross + (1 - xp.cos(angle)) * (cross @ cross)


def identity_like(array: Array) -> Array:
    """Identity matrix (3, 3) of an array's type, on its device."""
    if isinstance(array, np.ndarray):
        return np.eye(3, dtype=array.dtype)
    return array_module(array).eye(3, dtype=array.dtype, device=array.device)


def joint_transforms(joints: Array, rotations: Array) -> tuple[Array, Array]:
    """Forward kinematics.

    Args:
        joints: (24, 3) rest joints.
        rotations: (N, 24, 3, 3) rotation of each joint against its parent.

    Returns:
        Motions (N, 24, 3, 4) of the joints' frames from rest to pose, which leave the root joint
        in its place, and posed joints (N, 24, 3).
    """
    xp = array_module(rotations)
    world = [rotations[:, 0]]
    places = [xp.broadcast_to(joints[0], (len(rotations), 3))]
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        bone = joints[joint] - joints[parent]
        places.append(places[parent] + world[parent] @ bone)
        world.append(world[parent] @ rotations[:, joint])
    turn, place = xp.stack(world, axis=1), xp.stack(places, axis=1)  # (N, 24, 3, 3), (N, 24, 3)
    shift = place - (turn @ joints[..., None])[..., 0]
    return xp.concatenate([turn, shift[..., None]], axis=-1), place


def mirror_poses(poses: np.ndarray) -> np.ndarray:
    """Exchange left and right in poses (..., 72) in rad, as a mirror at x = 0 does."""
    turned = poses.reshape(*poses.shape[:-1], 24, 3)[..., _OTHER_SIDE, :]
    # A rotation's axis is a pseudovector: the mirror reverses its components in the mirror's plane.
    return (turned * np.array([1, -1, -1], dtype=poses.dtype)).reshape(poses.shape)


def _other_side(name: str) -> str:
    return name.replace("left", "*").replace("right", "left").replace("*", "right")


_OTHER_SIDE = [JOINT_NAMES.index(_other_side(name)) for name in JOINT_NAMES]


def skin_planes(planes: Array, transforms: Array, weights: Array) -> Array:
    """LBS in coordinate planes (N, 3, V): one matrix product, then three multiply-adds.

    Args:
        planes: (3, V) or (N, 3, V) coordinates of the rest body.
        transforms: (N, 24, 3, 4) of `joint_transforms`.
        weights: (24, V), columns sum to 1.
    """
    xp = array_module(transforms)
    blended = xp.reshape(xp.moveaxis(transforms, 1, 3), (-1, 24)) @ weights
    blended = xp.reshape(blended, (-1, 3, 4, weights.shape[1]))
    out = blended[:, :, 3]
    for axis in range(3):
        out = out + blended[:, :, axis] * planes[..., axis, None, :]
    return out


def pose_feature(rotations: Array) -> Array:
    """Factors (N, 207) of SMPL's pose blend shapes: R - I of every joint but the root.

    Args:
        rotations: (N, 24, 3, 3).
    """
    difference = rotations[:, 1:] - identity_like(rotations)
    return array_module(rotations).reshape(difference, (len(rotations), -1))


def skin_body(
    vertices: Array, joints: Array, weights: Array, poses: Array, posedirs: Array | None = None
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
    """LBS of points from rest to poses: (N, M, 3) float64 metres, the root joint at the origin.

    Args:
        points: (M, 3) or (N, M, 3) metres in rest.
        motions: (N, 24, 3, 4) of `rest_body.rest_to_pose`.
        weights: (M, 24), rows sum to 1.
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
