"""Offsets of garments in motion, in both versions of CLOTH3D section 4.2.

`posed` offsets are X = C - T in the frame's pose. `unposed` ones are freed from the pose:
X_new = K^-1(C, theta, J) - C_s, where K takes the registered garment from the rest pose to theta
by linear blend skinning with its own weights, and C_s is the garment in rest.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from drapeline.bodies.kinematics import rest_to_pose
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.storage import load_npz, save_npz

Version = Literal["posed", "unposed"]


@dataclass(frozen=True)
class SampleGarment:
    """A garment of a simulated sample, registered in its rest pose.

    Attributes:
        mask: (V,) bool body vertices that the garment covers.
        vertex: (M,) int32, their ids.
        corner: (M, 3) int32 garment vertices between which each one's point lies.
        bary: (M, 3) float32 weights of the corners.
        offsets: (V, 3) float32 static offsets in metres, zero outside of the mask.
        weights: (M, 24) float32 skinning weights.
    """

    mask: np.ndarray
    vertex: np.ndarray
    corner: np.ndarray
    bary: np.ndarray
    offsets: np.ndarray
    weights: np.ndarray

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_npz(path, **vars(self))

    def points(self, garment: np.ndarray) -> np.ndarray:
        """(N, M, 3) float32 registered points on garment vertices (N, C, 3)."""
        return np.einsum("nmki,mk->nmi", garment[:, self.corner], self.bary)


def load_sample_garment(path: str | Path) -> SampleGarment:
    """Read what `SampleGarment.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    names = list(SampleGarment.__dataclass_fields__)
    arrays = load_npz(path, *names)
    return SampleGarment(**{name: arrays[name] for name in names})


def moved(points: np.ndarray, motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """K: points from the rest pose to poses by linear blend skinning.

    Args:
        points: (M, 3) or (N, M, 3) metres in rest.
        motions: (N, 24, 3, 4) from `rest_to_pose`.
        weights: (M, 24).

    Returns:
        (N, M, 3) float64, the root joint at the origin.
    """
    blended = _blended(motions, weights)
    return (blended[..., :3] @ points[..., None])[..., 0] + blended[..., 3]


def moved_back(points: np.ndarray, motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """K^-1: posed points (N, M, 3) back to the rest pose; the exact inverse of `moved`."""
    blended = _blended(motions, weights)
    return np.linalg.solve(blended[..., :3], (points - blended[..., 3])[..., None])[..., 0]


def _blended(motions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(N, M, 3, 4) each point's motion."""
    flat = weights.astype(np.float64) @ motions.reshape(len(motions), 24, 12)
    return flat.reshape(len(motions), len(weights), 3, 4)


def dynamic_offsets(
    garment: SampleGarment,
    cloth: np.ndarray,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    version: Version,
) -> np.ndarray:
    """Offsets of frames.

    Args:
        garment: its registration.
        cloth: (N, C, 3) simulated vertices relative to the root joint, metres.
        body: super-resolved body of the sample's gender.
        shape: (10,).
        poses: (N, 72) of the frames, rad.
        version: "posed" or "unposed".

    Returns:
        (N, V, 3) float32 metres, zero outside of the mask.
    """
    points = garment.points(cloth)
    if version == "posed":
        found = points - posed_vertices(body, shape, poses)[0][:, garment.vertex]
    else:
        motions = rest_to_pose(body, shape, poses)
        found = moved_back(points, motions, garment.weights) - _static(garment, body, shape)
    out = np.zeros((len(poses), len(garment.mask), 3), dtype=np.float32)
    out[:, garment.vertex] = found
    return out


def dressed(
    garment: SampleGarment,
    offsets: np.ndarray,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    version: Version,
) -> np.ndarray:
    """Registered points (N, M, 3) in motion from dynamic offsets (N, V, 3): the way back.

    Args:
        garment, body, shape, poses, version: as for `dynamic_offsets`.
        offsets: what it returned, or a prediction.
    """
    found = offsets[:, garment.vertex]
    if version == "posed":
        return posed_vertices(body, shape, poses)[0][:, garment.vertex] + found
    motions = rest_to_pose(body, shape, poses)
    return moved(_static(garment, body, shape) + found, motions, garment.weights)


def _static(garment: SampleGarment, body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """C_s (M, 3): the registered points in the rest pose."""
    return rest_body(body, shape)[garment.vertex] + garment.offsets[garment.vertex]
