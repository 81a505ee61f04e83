"""Known bodies in motion: what networks see of them, and how garments follow them.

Coordinates are metres relative to the root joint, Z up. M body vertices that networks see, N
vertices of a garment, F frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from scipy import sparse
from scipy.spatial import cKDTree

from drapeline.bodies.kinematics import rest_to_pose
from drapeline.bodies.model import BodyModel, posed_vertices, shaped
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.skinning import skin
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.models.layers.lbs import skinned
from drapeline.models.layers.point_search import farthest_points

_NEAR_M = 0.005  # cloth that lies on skin is less than this above it


@dataclass(frozen=True)
class SkinningSettings:
    """How proposals get their skinning weights (equation 2).

    Attributes:
        neighbours: K, body vertices that weights are interpolated from.
        passes: of Laplacian smoothing.
        power: of the inverse distance, 1 or 2.
        coincident: "vertex", a body vertex at no distance counts alone; "released", not at all.
    """

    neighbours: int = 256
    passes: int = 100
    power: int = 1
    coincident: str = "vertex"


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

    def posed(self, shape: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) in metres and unit normals (F, M, 3) for poses (F, 72) in rad."""
        body, used = self._body, self._used
        vertices, joints = shaped(body, shape)
        directions = body.posedirs[used] if body.has_posedirs else None
        around, _ = skin(
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
    """A known body in motion: what networks are shown of it, and how garments follow it.

    Args:
        body: whole, in SMPL's format.
        surface: its vertices that networks see.
        shape: (10,).
    """

    def __init__(self, body: BodyModel, surface: BodySurface, shape: np.ndarray) -> None:
        self.model, self.surface, self.shape = body, surface, np.asarray(shape)

    @cached_property
    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (M, 3) and normals (M, 3) in the rest pose."""
        vertices, normals = self.shown(REST_POSE[None])
        return vertices[0], normals[0]

    def shown(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) and normals (F, M, 3) float32 in poses (F, 72)."""
        return self.surface.posed(self.shape, poses)

    def body_relative_points(self, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Points with where on the body they are: at rest with what is beneath, and how high above.

        Args:
            points: (F, P, 3) metres, root frame.
            poses: (F, 72) rad.

        Returns:
            (F, P, 7) float32: the points; the same moved to the rest pose with the nearest of all
            vertices of the body; and arsinh(h / 5 mm) of their height h over it along its normal,
            which tells skin from tight cloth as well as tight cloth from wide.
        """
        body = posed_vertices(self.model, self.shape, poses)[0]
        motions = self.transforms(poses).reshape(len(poses), -1, 16)  # (F, 24, 16)
        found = np.zeros((*points.shape[:2], 7), dtype=np.float32)
        for frame, cloud in enumerate(points):
            # A tree that is asked once is not worth balancing.
            tree = cKDTree(body[frame], balanced_tree=False, compact_nodes=False)
            _, near = tree.query(cloud)
            place = (self.model.weights[near] @ motions[frame]).reshape(-1, 4, 4)
            turn, shift = place[:, :3, :3], place[:, :3, 3]
            rest = np.linalg.solve(turn, (cloud - shift)[..., None])[..., 0]
            normals = np.einsum("pij,pj->pi", turn, self._rest_normals[near])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            height = ((cloud - body[frame, near]) * normals).sum(axis=1)
            found[frame] = np.column_stack([cloud, rest, np.arcsinh(height / _NEAR_M)])
        return found

    @cached_property
    def _rest_normals(self) -> np.ndarray:
        """(V, 3) of the whole body."""
        return vertex_normals(rest_body(self.model, self.shape), self.model.faces)

    def transforms(self, poses: np.ndarray) -> np.ndarray:
        """(F, 24, 4, 4) float32 motions of the joints' parts from the rest pose to poses."""
        motions = rest_to_pose(self.model, self.shape, poses)
        last = np.broadcast_to(np.array([0.0, 0.0, 0.0, 1.0]), (*motions.shape[:2], 1, 4))
        return np.concatenate([motions, last], axis=2).astype(np.float32)

    def weights(
        self, canonical: np.ndarray, faces: np.ndarray, settings: SkinningSettings
    ) -> np.ndarray:
        """(N, 24) float32 interpolated skinning weights of a canonical garment (N, 3)."""
        return interpolated_weights(
            canonical,
            faces,
            rest_body(self.model, self.shape),
            self.model.weights,
            settings.neighbours,
            settings.passes,
            power=settings.power,
            coincident=settings.coincident,
        )


class BodySet:
    """Bodies of both genders with the subset of vertices that networks see of either.

    Args:
        bodies: by gender; of one topology.
        count: M, vertices seen; those of the mean female body that lie farthest apart.
    """

    def __init__(self, bodies: Mapping[str, BodyModel], count: int) -> None:
        first = bodies[GENDERS[0]]
        points = torch.from_numpy(rest_body(first, np.zeros(10)).astype(np.float32))
        chosen = farthest_points(points[None], min(count, len(points)))[0].numpy()
        self.bodies = bodies
        self._surfaces = {gender: BodySurface(body, chosen) for gender, body in bodies.items()}

    def arrays(self) -> dict[str, np.ndarray]:
        """All that they are made of, by name."""
        return {
            f"{gender}/{key}": value
            for gender, surface in self._surfaces.items()
            for key, value in {**vars(self.bodies[gender]), "chosen": surface.chosen}.items()
            if isinstance(value, np.ndarray)
        }

    def of(self, gender: int, shape: np.ndarray) -> PosedBody:
        """The body of a gender's code and a shape (10,)."""
        name = GENDERS[gender]
        return PosedBody(self.bodies[name], self._surfaces[name], shape)


def proposals(canonical: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """(B, T, N, 3) interpolated linear blend skinning of canonical garments (equation 1).

    Args:
        canonical: (B, N, 3).
        weights: (B, N, 24).
        transforms: (B, T, 24, 4, 4).
    """
    with torch.no_grad():
        return skinned(*map(torch.from_numpy, (canonical, weights, transforms))).numpy()
