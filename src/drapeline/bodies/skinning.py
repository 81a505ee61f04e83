"""Forward kinematics and linear blend skinning, differentiable where its arrays are torch's."""

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from array_api_compat import array_namespace, device

from drapeline.frames import PARENTS

if TYPE_CHECKING:
    import torch

# Either will do; most jobs have plain arrays, and torch takes two seconds to import.
Array = TypeVar("Array", np.ndarray, "torch.Tensor")


def axis_angle_to_matrix(axis_angle: Array) -> Array:
    """(..., 3) rad -> (..., 3, 3); smooth through zero."""
    xp = array_namespace(axis_angle)
    angle = xp.sqrt(xp.sum(axis_angle**2, axis=-1, keepdims=True) + 1e-24)
    axis = axis_angle / angle
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    zero = xp.zeros_like(x)
    cross = xp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    cross = xp.reshape(cross, (*x.shape, 3, 3))
    angle = angle[..., None]
    return _identity(axis_angle) + xp.sin(angle) * cross + (1 - xp.cos(angle)) * (cross @ cross)


def _identity(like: Array) -> Array:
    return array_namespace(like).eye(3, dtype=like.dtype, device=device(like))


def joint_transforms(joints: Array, rotations: Array) -> tuple[Array, Array]:
    """Forward kinematics.

    Args:
        joints: (24, 3) rest joints.
        rotations: (N, 24, 3, 3) each joint's turn against its parent.

    Returns:
        (N, 24, 3, 4) motion of each joint's frame from rest to pose, which leaves the root
        joint in its place, and (N, 24, 3) posed joints.
    """
    xp = array_namespace(joints, rotations)
    world = [rotations[:, 0]]
    places = [xp.broadcast_to(joints[0], (len(rotations), 3))]
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        bone = joints[joint] - joints[parent]
        places.append(places[parent] + world[parent] @ bone)
        world.append(world[parent] @ rotations[:, joint])
    turn, place = xp.stack(world, axis=1), xp.stack(places, axis=1)  # (N, 24, 3, 3), (N, 24, 3)
    shift = place - (turn @ joints[..., None])[..., 0]
    return xp.concat([turn, shift[..., None]], axis=-1), place


def blend(vertices: Array, transforms: Array, weights: Array) -> Array:
    """Linear blend skinning in coordinate planes: one matrix product, then three multiply-adds.

    Args:
        vertices: (3, V) or (N, 3, V) coordinate planes of the rest body.
        transforms: (N, 24, 3, 4).
        weights: (24, V).

    Returns:
        (N, 3, V) planes of the posed body.
    """
    xp = array_namespace(vertices, transforms, weights)
    blended = xp.reshape(xp.permute_dims(transforms, (0, 2, 3, 1)), (-1, 24)) @ weights
    blended = xp.reshape(blended, (-1, 3, 4, weights.shape[1]))
    out = blended[:, :, 3]
    for axis in range(3):
        out = out + blended[:, :, axis] * vertices[..., axis, None, :]
    return out


def skin(
    vertices: Array,
    joints: Array,
    weights: Array,
    poses: Array,
    posedirs: Array | None = None,
) -> tuple[Array, Array]:
    """Pose a body; differentiable in every argument where those are torch's.

    Args:
        vertices: (V, 3) shaped rest body.
        joints: (24, 3) its joints.
        weights: (V, 24).
        poses: (N, 72) axis-angle in radians.
        posedirs: (V, 3, 207) pose blend shapes, or None for a body without.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), the root joint where it is at rest.
    """
    xp = array_namespace(vertices, poses)
    rotations = axis_angle_to_matrix(xp.reshape(poses, (-1, 24, 3)))
    transforms, places = joint_transforms(joints, rotations)
    planes = vertices.T
    if posedirs is not None:
        moved = pose_feature(rotations) @ xp.reshape(posedirs, (-1, posedirs.shape[-1])).T
        planes = planes + xp.reshape(moved, (len(moved), -1, 3)).swapaxes(1, 2)  # (N, 3, V)
    posed = blend(planes, transforms, weights.T)
    return posed.swapaxes(1, 2), places


def pose_feature(rotations: Array) -> Array:
    """(N, 24, 3, 3) -> (N, 207): how far every joint but the root is from rest."""
    turned = rotations[:, 1:] - _identity(rotations)
    return array_namespace(rotations).reshape(turned, (len(rotations), -1))
