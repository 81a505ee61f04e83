"""How each joint's part moves from the rest pose to another."""

import numpy as np

from drapeline.bodies.model import BodyModel, shaped
from drapeline.bodies.skinning import axis_angle_to_matrix, joint_transforms
from drapeline.frames import JOINT_NAMES, REST_POSE


def rest_to_pose(body: BodyModel, shape: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Rigid motions from `REST_POSE` to poses, with the root joint at the origin in both.

    Args:
        body: any SMPL-format body.
        shape: (10,).
        poses: (N, 72) axis-angle, rad.

    Returns:
        (N, 24, 3, 4) float64 rotation and translation in metres.
    """
    _, joints = shaped(body, shape)
    places = (joints - joints[0]).astype(np.float64)
    both = np.concatenate([REST_POSE[None], np.asarray(poses, dtype=np.float64)])
    rotations = axis_angle_to_matrix(both.reshape(-1, 24, 3))
    motions, _ = joint_transforms(places, rotations)
    rest, posed = motions[0], motions[1:]
    turn = posed[..., :3] @ rest[..., :3].swapaxes(-1, -2)
    shift = posed[..., 3] - (turn @ rest[..., 3:])[..., 0]
    return np.concatenate([turn, shift[..., None]], axis=-1)


def mirrored_poses(poses: np.ndarray) -> np.ndarray:
    """Poses (..., 72) in rad with left and right exchanged, as in a mirror at x = 0."""
    turned = poses.reshape(*poses.shape[:-1], 24, 3)[..., _OTHER_SIDE, :]
    # An axis of rotation is a pseudovector: of it the mirror turns what lies in its plane.
    return (turned * np.array([1, -1, -1], dtype=poses.dtype)).reshape(poses.shape)


def _other_side(name: str) -> str:
    return name.replace("left", "*").replace("right", "left").replace("*", "right")


_OTHER_SIDE = [JOINT_NAMES.index(_other_side(name)) for name in JOINT_NAMES]
