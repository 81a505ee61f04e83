"""What displacements are compared with: no pose at all, and the least that learns from poses.

Both know a displacement per cluster of the body, in the T-pose: the mean over training garments,
and a ridge regression of it on the pose. A garment takes them from the clusters around it.

K clusters, P numbers of a pose.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.smoothing import averaging_matrix, blur
from drapeline.learning_data.pose_displacements import POSE_NUMBERS, DisplacementData, encode_poses

# Shares of the mean diagonal element of the poses' scatter matrix.
PENALTIES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
_NEAREST, _PASSES = 8, 20
_SMALL_M = 1e-3
_LEAST_SCATTER = 1e-9


class _Sums(NamedTuple):
    """Sums over frames that both baselines are made of; poses are relative to their mean.

    Attributes:
        pose: (P,) mean pose.
        square: (P, P) of poses.
        total, count: (K, 3) displacements, and (K,) frames that have cloth there.
        moved, seen: (P, K, 3) and (P, K), both times the pose.
    """

    pose: np.ndarray
    square: np.ndarray
    total: np.ndarray
    count: np.ndarray
    moved: np.ndarray
    seen: np.ndarray


class ClusterDisplacement:
    """Displacements of the clusters, whatever the garment is; see `displacements`.

    Args:
        data: training and validation garments.
        bodies: by gender.
        clusters: (K,) ids of the bodies' vertices.

    Attributes:
        penalty: of `PENALTIES`, the best on validation frames.
    """

    def __init__(
        self, data: DisplacementData, bodies: Mapping[str, BodyModel], clusters: np.ndarray
    ) -> None:
        self._bodies, self._clusters = bodies, clusters
        self._near = [self._assign(data, garment) for garment in range(len(data.garment))]
        self._sums = sums = self._sum(data, data.rows("train"))
        self._known = np.flatnonzero(sums.count)
        self._mean = sums.total / np.maximum(sums.count, 1)[:, None]
        self.penalty = self._best_penalty(data)
        self._slope = self._slopes(self.penalty)

    def _assign(self, data: DisplacementData, garment: int) -> np.ndarray:
        """(V,) the cluster nearest to each vertex of a garment."""
        places = self._places(data.shape[garment], int(data.gender[garment]))
        return KDTree(places).query(data.garment_points(garment))[1]

    def _places(self, shape: np.ndarray, gender: int) -> np.ndarray:
        return rest_body(self._bodies[GENDERS[gender]], shape)[self._clusters]

    def _at_clusters(self, data: DisplacementData, row: int) -> tuple[np.ndarray, np.ndarray]:
        """(K, 3) mean displacements of a row, zero where it has no cloth, and (K,) where it has."""
        near = self._near[data.garment_index[row]]
        count = np.bincount(near, minlength=len(self._clusters))
        moved = data.displacements(row)
        total = np.stack([np.bincount(near, moved[:, k], len(count)) for k in range(3)], axis=1)
        return total / np.maximum(count, 1)[:, None], count > 0

    def _sum(self, data: DisplacementData, rows: np.ndarray) -> _Sums:
        """Sums over rows, read one after the other."""
        poses = data.pose[rows].astype(np.float64)
        mean, clusters = poses.mean(axis=0), len(self._clusters)
        total, count = np.zeros((clusters, 3)), np.zeros(clusters)
        moved, seen = np.zeros((POSE_NUMBERS, clusters, 3)), np.zeros((POSE_NUMBERS, clusters))
        for pose, row in zip(poses - mean, rows.tolist(), strict=True):
            values, here = self._at_clusters(data, row)
            total += values
            count += here
            moved += pose[:, None, None] * values
            seen += pose[:, None] * here
        square = (poses - mean).T @ (poses - mean)
        return _Sums(mean, square, total, count, moved, seen)

    def _slopes(self, penalty: float) -> np.ndarray:
        """(P, K, 3) metres per unit of a pose's numbers, by ridge regression."""
        sums = self._sums
        target = sums.moved - sums.seen[..., None] * self._mean
        # Where all poses are the same one, there is nothing to learn from them.
        strength = penalty * max(np.trace(sums.square) / POSE_NUMBERS, _LEAST_SCATTER)
        system = sums.square + strength * np.eye(POSE_NUMBERS)
        return np.linalg.solve(system, target.reshape(POSE_NUMBERS, -1)).reshape(target.shape)

    def _best_penalty(self, data: DisplacementData) -> float:
        """The penalty with the least error on the validation rows."""
        slopes = [self._slopes(penalty) for penalty in PENALTIES]
        errors = np.zeros(len(slopes))
        for row in data.rows("val").tolist():
            values, here = self._at_clusters(data, row)
            for index, slope in enumerate(slopes):
                predicted = self._mean + np.tensordot(data.pose[row] - self._sums.pose, slope, 1)
                errors[index] += np.linalg.norm(predicted - values, axis=1)[here].sum()
        return PENALTIES[int(errors.argmin())]

    def displacements(
        self, garment: Mesh, shape: np.ndarray, gender: int, poses: np.ndarray | None
    ) -> np.ndarray:
        """(N, V, 3) metres in the T-pose of a garment at rest; without poses, (1, V, 3) the mean.

        Args:
            garment: triangles, root-relative metres.
            shape: (10,) of the wearer.
            gender: of the wearer, 0 female, 1 male.
            poses: (N, 72) rad.
        """
        places = self._places(shape, gender)[self._known]
        away, near = KDTree(places).query(garment.vertices, k=min(_NEAREST, len(places)))
        away, near = away.reshape(len(garment.vertices), -1), near.reshape(len(away), -1)
        share = 1 / (away + _SMALL_M)
        share /= share.sum(axis=1, keepdims=True)
        values = self._mean[None]
        if poses is not None:
            values = values + np.tensordot(encode_poses(poses) - self._sums.pose, self._slope, 1)
        average = averaging_matrix(garment.faces, len(garment.vertices))
        taken = values[:, self._known][:, near]  # (N, V, 8, 3)
        return np.stack([blur(np.einsum("vk,vkj->vj", share, x), average, _PASSES) for x in taken])
