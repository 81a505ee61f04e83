"""Offsets of garments in motion, in both versions of CLOTH3D section 4.2.

`posed` offsets are X = C - T in the frame's pose. `unposed` ones are freed from the pose:
X_new = K^-1(C, theta, J) - C_s, where K takes the registered garment from the rest pose to theta
by linear blend skinning with its own weights, and C_s is the garment in rest.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from drapeline.bodies.kinematics import skin_points, unskin_points
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.storage import load_npz, save_npz

Version = Literal["posed", "unposed"]


@dataclass(frozen=True)
class SampleGarment:
    """A garment of a simulated sample, registered in its rest pose."""

    mask: np.ndarray  # (V,) bool body vertices that the garment covers
    vertex: np.ndarray  # (M,) int32, their ids
    corner: np.ndarray  # (M, 3) int32 garment vertices between which each one's point lies
    bary: np.ndarray  # (M, 3) float32 weights of the corners
    offsets: np.ndarray  # (V, 3) float32 static offsets in metres, zero outside of the mask
    weights: np.ndarray  # (M, 24) float32 skinning weights

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_npz(path, **vars(self))

    def points(self, garment: np.ndarray) -> np.ndarray:
        """(N, M, 3) float32 registered points on garment vertices (N, C, 3)."""
        return np.einsum("nmki,mk->nmi", garment[:, self.corner], self.bary)


_ARRAYS = {
    "mask": "bool v",
    "vertex": "int<v m",
    "corner": "int m 3",
    "bary": "float m 3",
    "offsets": "float v 3",
    "weights": "float m 24",
}


def load_sample_garment(path: str | Path) -> SampleGarment:
    """Read what `SampleGarment.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return SampleGarment(**load_npz(path, _ARRAYS))


def dynamic_offsets(
    garment: SampleGarment,
    cloth: np.ndarray,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    version: Version,
) -> np.ndarray:
    """(N, V, 3) float32 metres: a garment's offsets in some frames, zero outside of the mask.

    Args:
        garment: its registration.
        cloth: (N, C, 3) simulated vertices relative to the root joint, metres.
        body: super-resolved body of the sample's gender.
        shape: (10,).
        poses: (N, 72) of the frames, rad.
        version: "posed" or "unposed".
    """
    points = garment.points(cloth)
    if version == "posed":
        dynamic = points - posed_vertices(body, shape, poses)[0][:, garment.vertex]
    else:
        motions = rest_to_pose(body, shape, poses)
        rest = unskin_points(points, motions, garment.weights)
        dynamic = rest - _static_points(garment, body, shape)
    out = np.zeros((len(poses), len(garment.mask), 3), dtype=np.float32)
    out[:, garment.vertex] = dynamic
    return out


def points_from_offsets(
    garment: SampleGarment,
    offsets: np.ndarray,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    version: Version,
) -> np.ndarray:
    """(N, M, 3) root-relative metres: the inverse of `dynamic_offsets`, at the registered points.

    Args:
        garment, body, shape, poses, version: as for `dynamic_offsets`.
        offsets: (N, V, 3) what it returned, or a prediction.
    """
    dynamic = offsets[:, garment.vertex]
    if version == "posed":
        return posed_vertices(body, shape, poses)[0][:, garment.vertex] + dynamic
    motions = rest_to_pose(body, shape, poses)
    rest = _static_points(garment, body, shape) + dynamic
    return skin_points(rest, motions, garment.weights)


def _static_points(garment: SampleGarment, body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """C_s (M, 3): the registered points in the rest pose."""
    return rest_body(body, shape)[garment.vertex] + garment.offsets[garment.vertex]
