"""Put a motion on a body of another size: stride by leg length, feet on the floor."""

from dataclasses import dataclass

import numpy as np

from drapeline.bodies.model import BodyModel, shape_body
from drapeline.frames import FPS, JOINT_NAMES

# The floor is at this percentile of the frames' lowest points: a single stray frame must not lift
# the whole clip off the ground.
FLOOR_PERCENTILE = 5.0
CONTACT_M = 0.015  # a foot whose lowest vertex is below this height stands


@dataclass(frozen=True)
class GroundContact:
    """How well a placed motion meets the floor z = 0.

    Attributes:
        penetration_m: greatest depth of any vertex below the floor.
        mean_penetration_m: depth of each frame's lowest vertex below the floor, averaged.
        foot_sliding_m_s: mean horizontal speed of a standing foot's lowest vertex; 0 if no
            foot ever stands.
    """

    penetration_m: float
    mean_penetration_m: float
    foot_sliding_m_s: float


def leg_length_m(body: BodyModel, shape: np.ndarray) -> float:
    """Hip to knee to ankle, mean of both legs."""
    _, joints = shape_body(body, shape)
    lengths = []
    for side in ("left", "right"):
        hip, knee, ankle = (
            joints[JOINT_NAMES.index(f"{side}_{name}")] for name in ("hip", "knee", "ankle")
        )
        lengths.append(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))
    return float(np.mean(lengths))


def place_on_floor(vertices: np.ndarray, trans: np.ndarray, scale: float) -> np.ndarray:
    """Scale the root's path and set it on the floor.

    Args:
        vertices: (N, V, 3) posed body relative to its root joint, metres.
        trans: (N, 3) root path of the skeleton that was recorded, metres, Z up.
        scale: leg length of this body over that of the skeleton.

    Returns:
        (N, 3) float64 path of this body's root joint.
    """
    path = np.array(trans, dtype=np.float64)
    path = path[0] * [1, 1, 0] + (path - path[0] * [1, 1, 0]) * scale
    lowest = vertices[:, :, 2].min(axis=1) + path[:, 2]
    path[:, 2] -= np.percentile(lowest, FLOOR_PERCENTILE)
    return path


def ground_contact(
    vertices: np.ndarray, trans: np.ndarray, feet: list[np.ndarray]
) -> GroundContact:
    """Measure floor penetration and foot sliding.

    Args:
        vertices: (N, V, 3) root-relative body.
        trans: (N, 3) placed root path.
        feet: vertex ids of each foot.
    """
    depth = -(vertices[:, :, 2].min(axis=1) + trans[:, 2])
    speeds = []
    for ids in feet:
        sole = vertices[:, ids] + trans[:, None]
        lowest = sole[:, :, 2].argmin(axis=1)
        frames = np.arange(len(sole) - 1)
        here, there = sole[frames, lowest[:-1]], sole[frames + 1, lowest[:-1]]
        stands = (here[:, 2] < CONTACT_M) & (there[:, 2] < CONTACT_M)
        speeds.append(np.linalg.norm((there - here)[stands, :2], axis=1) * FPS)
    speeds = np.concatenate(speeds)
    return GroundContact(
        penetration_m=float(max(depth.max(), 0)),
        mean_penetration_m=float(np.maximum(depth, 0).mean()),
        foot_sliding_m_s=float(speeds.mean()) if len(speeds) else 0.0,
    )
