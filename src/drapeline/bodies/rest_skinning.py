"""Points at rest moved to poses by way of the T-pose, which takes a body's vertices along exactly.

Blending the joints' motions from the rest pose itself would be off by millimetres to a centimetre
where several joints have a part. The root joint is at the origin everywhere.
"""

import numpy as np

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms
from drapeline.bodies.model import BodyModel, shape_body
from drapeline.bodies.skinning import unskin_points
from drapeline.frames import REST_POSE


def tpose_motions(body: BodyModel, shape: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Motions of the joints' frames from the T-pose, for `skin_points` and `unskin_points`.

    Args:
        body: of the wearer.
        shape: (10,) of the wearer.
        poses: (N, 72) axis-angle, rad.

    Returns:
        (N, 24, 3, 4) float64 rotation and translation in metres.
    """
    _, joints = shape_body(body, shape)
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float64).reshape(-1, 24, 3))
    motions, _ = joint_transforms((joints - joints[0]).astype(np.float64), rotations)
    return motions


def straighten(
    points: np.ndarray, weights: np.ndarray, body: BodyModel, shape: np.ndarray
) -> np.ndarray:
    """(V, 3) float64 points in the T-pose, from points (V, 3) at rest with weights (V, 24)."""
    return unskin_points(points[None], tpose_motions(body, shape, REST_POSE[None]), weights)[0]
