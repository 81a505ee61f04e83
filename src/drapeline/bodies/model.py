"""SMPL-format bodies: the file, and posing it by linear blend skinning."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from drapeline.frames import PARENTS
from drapeline.storage import load_npz


@dataclass(frozen=True)
class BodyModel:
    """A body in SMPL's format; Y up, facing +Z, T-pose, metres.

    Attributes:
        v_template: (V, 3) float32 mean body.
        shapedirs: (V, 3, 10) float32, metres per unit of shape.
        posedirs: (V, 3, 207) float32 pose blend shapes.
        J_regressor: (24, V) float32.
        weights: (V, 24) float32 skinning weights.
        faces: (F, 3) int32.
        vt, ft: (T, 2) float32 and (F, 3) int32 texture coordinates, or None.
        segmentation: (V,) int32, the joint whose part each vertex belongs to.
        name: which body model and version this is, such as "drapeline-anny-female-1".
    """

    v_template: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    J_regressor: np.ndarray
    weights: np.ndarray
    faces: np.ndarray
    vt: np.ndarray | None
    ft: np.ndarray | None
    segmentation: np.ndarray
    name: str


def load_body(path: str | Path) -> BodyModel:
    """Read a baked body."""
    a = load_npz(path, "v_template", "shapedirs", "posedirs", "J_regressor", "weights", "f")
    return BodyModel(
        a["v_template"],
        a["shapedirs"],
        a["posedirs"],
        a["J_regressor"],
        a["weights"],
        a["f"],
        a.get("vt"),
        a.get("ft"),
        a["segmentation"],
        str(a.get("name", Path(path).stem)),
    )


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


def shaped(body: BodyModel, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rest vertices (V, 3) and joints (24, 3) of a shape (10,), in the SMPL frame."""
    vertices = body.v_template + body.shapedirs @ np.asarray(shape, dtype=np.float32)
    return vertices, body.J_regressor @ vertices


def posed_vertices(
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    trans: np.ndarray | None = None,
    *,
    chunk: int = 32,
) -> tuple[np.ndarray, np.ndarray]:
    """Posed body in the world frame with its root joint at `trans` (SMPL; CLOTH3D's placement).

    Args:
        shape: (10,) shape coefficients.
        poses: (N, 72) axis-angle in radians.
        trans: (N, 3) world position of the root joint in metres; the origin if None.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), float32.
    """
    vertices, joints = shaped(body, shape)
    rest, rest_joints = torch.from_numpy(vertices), torch.from_numpy(joints)
    rest, rest_joints = rest - rest_joints[0], rest_joints - rest_joints[0]
    rotations = axis_angle_to_matrix(
        torch.as_tensor(np.asarray(poses), dtype=torch.float32).reshape(-1, 24, 3)
    )
    count = len(rotations)
    world_r = [rotations[:, 0]]
    world_t = [torch.zeros(count, 3)]
    for joint in range(1, 24):
        parent = int(PARENTS[joint])
        bone = rest_joints[joint] - rest_joints[parent]
        world_r.append(world_r[parent] @ rotations[:, joint])
        world_t.append(world_t[parent] + world_r[parent] @ bone)
    r, t = torch.stack(world_r, 1), torch.stack(world_t, 1)
    offset = t - torch.einsum("njab,jb->nja", r, rest_joints)
    if trans is not None:
        shift = torch.as_tensor(np.asarray(trans), dtype=torch.float32)
        offset = offset + shift[:, None]
        t = t + shift[:, None]
    weights = torch.from_numpy(np.ascontiguousarray(body.weights.T))
    pose_feature = (rotations[:, 1:] - torch.eye(3)).reshape(count, 207)
    has_pose_shapes = bool(np.any(body.posedirs))
    directions = (
        torch.from_numpy(body.posedirs).reshape(-1, 207).T.contiguous() if has_pose_shapes else None
    )
    transforms = torch.cat([r, offset[..., None]], -1)  # (N, 24, 3, 4)
    out = np.zeros((count, len(vertices), 3), dtype=np.float32)
    for start in range(0, count, chunk):
        part = slice(start, min(start + chunk, count))
        blended = transforms[part].permute(0, 2, 3, 1).reshape(-1, 24) @ weights
        blended = blended.unflatten(0, (-1, 3, 4))  # (n, 3, 4, V)
        points = rest.T
        if directions is not None:
            points = points + (pose_feature[part] @ directions).unflatten(1, (-1, 3)).mT
        else:
            points = points.expand(blended.shape[0], -1, -1)
        moved = (blended[:, :, :3] * points[:, None]).sum(2) + blended[:, :, 3]
        out[part] = moved.mT.numpy()
    return out, t.numpy()
