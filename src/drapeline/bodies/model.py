"""SMPL-format bodies: the model, and posing it by linear blend skinning."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.smpl_files import read_body_arrays
from drapeline.frames import PARENTS
from drapeline.storage import save_npz


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

    @cached_property
    def has_posedirs(self) -> bool:
        """Whether any pose blend shape differs from zero; looking at all takes milliseconds."""
        return bool(np.any(self.posedirs))


def load_body(path: str | Path) -> BodyModel:
    """Read a baked body, or a real SMPL one (`.npz`, `.pkl`); nothing in the file is executed.

    Raises:
        InputError: names the file and what in it is missing, forbidden or misshapen.
    """
    a = read_body_arrays(path)
    return BodyModel(
        v_template=a["v_template"],
        shapedirs=a["shapedirs"],
        posedirs=a["posedirs"],
        J_regressor=a["J_regressor"],
        weights=a["weights"],
        faces=a["f"],
        vt=a.get("vt"),
        ft=a.get("ft"),
        segmentation=a["segmentation"],
        name=str(a["name"]),
    )


def save_body(path: str | Path, body: BodyModel, **about: str | int) -> None:
    """Write a body with SMPL's own key names, readable by `load_body` and by `smplx.SMPL`.

    Args:
        about: further entries, such as a licence.
    """
    parents = PARENTS.astype(np.int64).copy()
    parents[0] = 2**32 - 1  # as SMPL's own files mark the root
    texture = {} if body.vt is None else {"vt": body.vt, "ft": body.ft}
    save_npz(
        path,
        v_template=body.v_template,
        shapedirs=body.shapedirs,
        posedirs=body.posedirs,
        J_regressor=body.J_regressor,
        weights=body.weights,
        kintree_table=np.stack([parents, np.arange(24)]),
        f=body.faces,
        segmentation=body.segmentation,
        name=body.name,
        **texture,
        **about,
    )


def shaped(body: BodyModel, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rest vertices (V, 3) and joints (24, 3) of a shape (10,), in the SMPL frame."""
    vertices = body.v_template + body.shapedirs @ np.asarray(shape, dtype=np.float32)
    return vertices, body.J_regressor @ vertices


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
            planes + (_pose_feature(rotations) @ posedirs.flatten(0, 1).T).unflatten(1, (-1, 3)).mT
        )  # (N, 3, V)
    return blend(planes, transforms, weights.T.contiguous()).mT, places


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
        chunk: frames worked on at once: memory against overhead.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), float32.
    """
    vertices, joints = shaped(body, shape)
    planes = torch.from_numpy(np.ascontiguousarray((vertices - joints[0]).T))
    rest_joints = torch.from_numpy(joints - joints[0])
    weights = torch.from_numpy(np.ascontiguousarray(body.weights.T))
    directions = _pose_directions(body)
    pose = torch.tensor(np.asarray(poses), dtype=torch.float32).reshape(-1, 24, 3)
    out = np.zeros((len(pose), len(vertices), 3), dtype=np.float32)
    with torch.no_grad():
        rotations = axis_angle_to_matrix(pose)
        transforms, places = joint_transforms(rest_joints, rotations)
        if trans is not None:
            shift = torch.tensor(np.asarray(trans), dtype=torch.float32)[:, None]
            transforms[..., 3] += shift
            places = places + shift
        for start in range(0, len(pose), chunk):
            part = slice(start, start + chunk)
            points = planes
            if directions is not None:
                feature = _pose_feature(rotations[part])
                points = planes + (feature @ directions).unflatten(1, (3, -1))
            torch.from_numpy(out[part]).mT.copy_(blend(points, transforms[part], weights))
    return out, places.numpy()


def _pose_feature(rotations: torch.Tensor) -> torch.Tensor:
    """(N, 24, 3, 3) -> (N, 207): how far every joint but the root is from rest."""
    identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
    return (rotations[:, 1:] - identity).flatten(1)


def _pose_directions(body: BodyModel) -> torch.Tensor | None:
    """(207, 3 * V) pose blend shapes in coordinate planes; None where all are zero."""
    if not body.has_posedirs:
        return None
    planes = np.ascontiguousarray(body.posedirs.transpose(2, 1, 0))
    return torch.from_numpy(planes).flatten(1)
