"""Offsets of garments in motion, in both versions of CLOTH3D section 4.2.

`posed` offsets are X = C - T in the frame's pose. `unposed` ones are freed from the pose:
X_new = K^-1(C, theta, J) - C_s, where K takes the registered garment from the rest pose to theta
by linear blend skinning with its own weights, and C_s is the garment in rest.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from drapeline.bodies.kinematics import skin_points, unskin_points
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.storage import load_record, save_record

Version = Literal["posed", "unposed"]


@dataclass(frozen=True)
class SampleGarment:
    """A garment of a simulated sample, registered in its rest pose."""

    mask: Annotated[np.ndarray, "bool v"]  # body vertices that the garment covers
    vertex: Annotated[np.ndarray, "int<v m"]  # their ids
    corner: Annotated[np.ndarray, "int m 3"]  # garment vertices that each one's point lies between
    bary: Annotated[np.ndarray, "float m 3"]  # weights of the corners
    offsets: Annotated[np.ndarray, "float v 3"]  # static, in metres, zero outside of the mask
    weights: Annotated[np.ndarray, "float m 24"]  # of skinning

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_record(path, self)

    def points(self, garment: np.ndarray) -> np.ndarray:
        """(N, M, 3) float32 registered points on garment vertices (N, C, 3)."""
        return np.einsum("nmki,mk->nmi", garment[:, self.corner], self.bary)


def load_sample_garment(path: str | Path) -> SampleGarment:
    """Read what `SampleGarment.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return load_record(path, SampleGarment)


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
