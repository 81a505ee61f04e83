"""SMPL-format bodies: the model, and posing it by linear blend skinning."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from array_api_compat import array_namespace, device

from drapeline.bodies.smpl_files import read_body_arrays
from drapeline.frames import PARENTS
from drapeline.storage import save_npz

if TYPE_CHECKING:
    import torch

# Kinematics take either; most jobs only need arrays, and torch takes two seconds to import.
Array = TypeVar("Array", np.ndarray, "torch.Tensor")


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
        moved = _pose_feature(rotations) @ xp.reshape(posedirs, (-1, posedirs.shape[-1])).T
        planes = planes + xp.reshape(moved, (len(moved), -1, 3)).swapaxes(1, 2)  # (N, 3, V)
    posed = blend(planes, transforms, weights.T)
    return posed.swapaxes(1, 2), places


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
    planes = np.ascontiguousarray((vertices - joints[0]).T)
    directions = _pose_directions(body)
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float32).reshape(-1, 24, 3))
    transforms, places = joint_transforms(joints - joints[0], rotations)
    if trans is not None:
        shift = np.asarray(trans, dtype=np.float32)[:, None]
        transforms[..., 3] += shift
        places = places + shift
    out = np.zeros((len(rotations), len(vertices), 3), dtype=np.float32)
    for start in range(0, len(rotations), chunk):
        part = slice(start, start + chunk)
        points = planes
        if directions is not None:
            moved = _pose_feature(rotations[part]) @ directions
            points = planes + moved.reshape(len(moved), 3, -1)
        out[part] = blend(points, transforms[part], body.weights.T).swapaxes(1, 2)
    return out, places


def _pose_feature(rotations: Array) -> Array:
    """(N, 24, 3, 3) -> (N, 207): how far every joint but the root is from rest."""
    turned = rotations[:, 1:] - _identity(rotations)
    return array_namespace(rotations).reshape(turned, (len(rotations), -1))


def _pose_directions(body: BodyModel) -> np.ndarray | None:
    """(207, 3 * V) pose blend shapes in coordinate planes; None where all are zero."""
    if not np.any(body.posedirs):
        return None
    return np.ascontiguousarray(body.posedirs.transpose(2, 1, 0)).reshape(207, -1)
