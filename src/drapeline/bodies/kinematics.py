"""Rotations and forward kinematics of the SMPL skeleton, for NumPy's arrays and torch's tensors."""

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
    cross = xp.reshape(cross, (*x.shape, 3, 3))
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
