"""Known bodies in motion: what networks are given of them.

Coordinates are metres relative to the root joint, Z up. M body vertices that networks are given, F
frames.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import torch
from scipy import sparse

from drapeline.bodies.model import BodyModel, shape_body
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.skinning import skin_body
from drapeline.frames import GENDERS, REST_POSE
from drapeline.learning_data.body_relative_points import joint_transforms
from drapeline.models.layers.point_search import farthest_points


class BodySurface:
    """A fixed subset of a body's vertices, with the exact normals of the whole body there.

    Args:
        body: in SMPL's format.
        chosen: (M,) vertex ids, kept as an attribute.
    """

    def __init__(self, body: BodyModel, chosen: np.ndarray) -> None:
        faces = body.faces[np.isin(body.faces, chosen).any(axis=1)]
        self._used, places = np.unique(np.r_[faces.ravel(), chosen], return_inverse=True)
        self._corners = places[: faces.size].reshape(faces.shape)
        self._chosen = places[faces.size :]
        self.chosen = chosen
        self._body = body
        # Rows sum the area vectors of the faces about each chosen vertex.
        row = np.full(len(self._used), -1)
        row[self._chosen] = np.arange(len(chosen))
        rows, column = row[self._corners].ravel(), np.repeat(np.arange(len(faces)), 3)
        about = rows >= 0
        self._around = sparse.csr_matrix(
            (np.ones(about.sum(), dtype=np.float32), (rows[about], column[about])),
            shape=(len(chosen), len(faces)),
        )

    def pose(self, shape: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) in metres and unit normals (F, M, 3) for poses (F, 72) in rad."""
        body, used = self._body, self._used
        vertices, joints = shape_body(body, shape)
        directions = body.posedirs[used] if body.has_posedirs else None
        around, _ = skin_body(
            vertices[used] - joints[0],
            joints - joints[0],
            body.weights[used],
            np.asarray(poses, dtype=np.float32),
            directions,
        )
        a, b, c = (around[:, self._corners[:, corner]] for corner in range(3))
        area = np.cross(b - a, c - a)  # (F, K, 3)
        flat = self._around @ area.transpose(1, 0, 2).reshape(area.shape[1], -1)
        normals = flat.reshape(len(self._chosen), len(area), 3).transpose(1, 0, 2)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        return around[:, self._chosen], normals / np.maximum(length, 1e-20)


class PosedBody:
    """A body of known shape in any poses.

    Args:
        model: whole, in SMPL's format.
        surface: its vertices that networks are given.
        shape: (10,).
    """

    def __init__(self, model: BodyModel, surface: BodySurface, shape: np.ndarray) -> None:
        self.model, self.surface, self.shape = model, surface, np.asarray(shape)

    @cached_property
    def rest_surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (M, 3) and normals (M, 3) in the rest pose."""
        vertices, normals = self.pose_surface(REST_POSE[None])
        return vertices[0], normals[0]

    def pose_surface(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) and normals (F, M, 3) float32 in poses (F, 72)."""
        return self.surface.pose(self.shape, poses)

    def transforms(self, poses: np.ndarray) -> np.ndarray:
        """(F, 24, 4, 4) float32 motions of the joints' parts from the rest pose to poses."""
        return joint_transforms(self.model, self.shape, poses)


class BodySet:
    """Bodies of both genders with the vertices of either that networks are given.

    Args:
        models: by gender; of one topology.
        count: M, vertices that networks are given: those of the mean female body that lie farthest
            apart.
    """

    def __init__(self, models: Mapping[str, BodyModel], count: int) -> None:
        first = models[GENDERS[0]]
        points = torch.from_numpy(rest_body(first, np.zeros(10)).astype(np.float32))
        chosen = farthest_points(points[None], min(count, len(points)))[0].numpy()
        self.models, self.count = models, count
        self._surfaces = {gender: BodySurface(model, chosen) for gender, model in models.items()}

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the bodies."""
        return {
            f"{gender}/{key}": value
            for gender, surface in self._surfaces.items()
            for key, value in {**vars(self.models[gender]), "chosen": surface.chosen}.items()
            if isinstance(value, np.ndarray)
        }

    def of(self, gender: int, shape: np.ndarray) -> PosedBody:
        """The body of a gender's code and a shape (10,)."""
        name = GENDERS[gender]
        return PosedBody(self.models[name], self._surfaces[name], shape)
