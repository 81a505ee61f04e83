"""Linear blend skinning of SMPL-format bodies, differentiable in all that it is given."""

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.frames import PARENTS


def axis_angle_to_matrix(axis_angle: torch.Tensor) -> torch.Tensor:
    """(..., 3) rad -> (..., 3, 3); smooth through zero."""
    angle = torch.sqrt((axis_angle**2).sum(-1, keepdim=True) + 1e-24)
    axis = axis_angle / angle
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    angle = angle[..., None]
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + torch.sin(angle) * cross + (1 - torch.cos(angle)) * (cross @ cross)


def joint_transforms(
    joints: torch.Tensor, rotations: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Forward kinematics.

    Args:
        joints: (24, 3) rest joints.
        rotations: (N, 24, 3, 3) each joint's turn against its parent.

    Returns:
        (N, 24, 3, 4) motion of each joint's frame from rest to pose, which leaves the root
        joint in its place, and (N, 24, 3) posed joints.
    """
    world, places = [rotations[:, 0]], [joints[0].expand(len(rotations), 3)]
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        bone = joints[joint] - joints[parent]
        places.append(places[parent] + world[parent] @ bone)
        world.append(world[parent] @ rotations[:, joint])
    turn, place = torch.stack(world, 1), torch.stack(places, 1)  # (N, 24, 3, 3), (N, 24, 3)
    shift = place - (turn @ joints[..., None])[..., 0]
    return torch.cat([turn, shift[..., None]], -1), place


def blend(vertices: torch.Tensor, transforms: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """Linear blend skinning in coordinate planes: one matrix product, then three multiply-adds.

    Args:
        vertices: (3, V) or (N, 3, V) coordinate planes of the rest body.
        transforms: (N, 24, 3, 4).
        weights: (24, V), contiguous.

    Returns:
        (N, 3, V) planes of the posed body.
    """
    blended = transforms.permute(0, 2, 3, 1).reshape(-1, 24) @ weights
    blended = blended.unflatten(0, (-1, 3, 4))  # (N, 3, 4, V)
    out = blended[:, :, 3]
    for axis in range(3):
        out = torch.addcmul(out, blended[:, :, axis], vertices[..., axis, :].unsqueeze(-2))
    return out


def skin(
    vertices: torch.Tensor,
    joints: torch.Tensor,
    weights: torch.Tensor,
    poses: torch.Tensor,
    posedirs: torch.Tensor | None = None,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Pose a body; differentiable in every argument.

    Args:
        vertices: (V, 3) shaped rest body.
        joints: (24, 3) its joints.
        weights: (V, 24).
        poses: (N, 72) axis-angle in radians.
        posedirs: (V, 3, 207) pose blend shapes, or None for a body without.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), the root joint where it is at rest.
    """
    rotations = axis_angle_to_matrix(poses.unflatten(-1, (24, 3)))
    transforms, places = joint_transforms(joints, rotations)
    planes = vertices.T
    if posedirs is not None:
        planes = (
            planes + (pose_feature(rotations) @ posedirs.flatten(0, 1).T).unflatten(1, (-1, 3)).mT
        )  # (N, 3, V)
    return blend(planes, transforms, weights.T.contiguous()).mT, places


def pose_feature(rotations: torch.Tensor) -> torch.Tensor:
    """(N, 24, 3, 3) -> (N, 207): how far every joint but the root is from rest."""
    identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
    return (rotations[:, 1:] - identity).flatten(1)


def pose_directions(body: BodyModel) -> torch.Tensor | None:
    """(207, 3 * V) pose blend shapes in coordinate planes; None where all are zero."""
    if not body.has_posedirs:
        return None
    planes = np.ascontiguousarray(body.posedirs.transpose(2, 1, 0))
    return torch.from_numpy(planes).flatten(1)
