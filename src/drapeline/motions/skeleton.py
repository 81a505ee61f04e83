"""The two skeletons of a retargeting: the captured one, and a reference with SMPL's joints."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES, PARENTS

# Joint offsets from the parent in metres (Y up, facing +Z, T-pose): the mean of the two default
# bodies, rounded and made symmetric. Motions are fitted to the floor with it; each body is then
# placed by its own leg length.
_HALF = {
    "hip": (0.110, -0.010, -0.005),
    "knee": (0.0, -0.385, 0.0),
    "ankle": (0.0, -0.435, 0.0),
    "foot": (0.0, -0.050, 0.145),
    "collar": (0.025, 0.150, 0.030),
    "shoulder": (0.150, -0.020, 0.0),
    "elbow": (0.260, 0.0, 0.0),
    "wrist": (0.235, 0.0, 0.0),
    "hand": (0.105, 0.0, 0.0),
}
_MIDDLE = {
    "pelvis": (0.0, 0.0, 0.0),
    "spine1": (0.0, 0.090, -0.040),
    "spine2": (0.0, 0.100, 0.005),
    "spine3": (0.0, 0.160, 0.005),
    "neck": (0.0, 0.200, 0.020),
    "head": (0.0, 0.100, 0.040),
}


def _offset(name: str) -> tuple[float, float, float]:
    if name in _MIDDLE:
        return _MIDDLE[name]
    side, part = name.split("_")
    x, y, z = _HALF[part]
    return (x if side == "left" else -x, y, z)


REFERENCE_OFFSETS = np.array([_offset(name) for name in JOINT_NAMES])
REFERENCE_OFFSETS.setflags(write=False)
REFERENCE_LEG_LENGTH_M = 0.385 + 0.435  # hip to knee to ankle
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
Y_UP_TO_Z_UP.setflags(write=False)


@dataclass(frozen=True)
class Take:
    """A captured motion on its own skeleton, before retargeting.

    The skeleton's rest pose is where every global rotation is the identity, as in a BVH file.
    """

    source: str  # file the take was read from; named in errors
    names: tuple[str, ...]  # joint names, parents before children
    parents: np.ndarray  # (J,) int, -1 for the root
    offsets: np.ndarray  # (J, 3) rest position of each joint from its parent, in the file's unit
    rotations: np.ndarray  # (N, J, 3, 3) global rotation of each joint away from the rest pose
    positions: np.ndarray  # (N, J, 3) joint positions in the file's unit
    times_s: np.ndarray  # (N,) strictly increasing seconds

    def rest_positions(self) -> np.ndarray:
        """(J, 3) joint positions of the rest pose, root at the origin."""
        return chain(self.parents, np.eye(3)[None, None], self.offsets[None])[0]


def chain(parents: np.ndarray, rotations: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(N, J, 3) places of joints by their global rotations; the root is at the origin.

    Args:
        parents: (J,) int, parents before children, -1 for the root.
        rotations: (N, J, 3, 3) global, or anything that broadcasts to it.
        offsets: (N, J, 3), or (1, J, 3) when bones keep their length.
    """
    count = max(len(rotations), len(offsets))
    joints = len(parents)
    rotations = np.broadcast_to(rotations, (count, joints, 3, 3))
    offsets = np.broadcast_to(offsets, (count, joints, 3))
    positions = np.zeros((count, joints, 3))
    for joint in range(1, joints):
        parent = parents[joint]
        turned = np.einsum("nab,nb->na", rotations[:, parent], offsets[:, joint])
        positions[:, joint] = positions[:, parent] + turned
    return positions


def globals_from_locals(parents: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Global rotations (N, J, 3, 3) from local ones, parents before children."""
    out = np.array(local, dtype=np.float64)
    for joint in range(1, len(parents)):
        out[:, joint] = out[:, parents[joint]] @ local[:, joint]
    return out


def poses_from_globals(rotations: np.ndarray) -> np.ndarray:
    """SMPL pose vectors (N, 72) in radians from global rotations (N, 24, 3, 3)."""
    local = np.array(rotations, dtype=np.float64)
    local[:, 1:] = np.swapaxes(rotations[:, PARENTS[1:]], -1, -2) @ rotations[:, 1:]
    return Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 72)


def globals_from_poses(poses: np.ndarray) -> np.ndarray:
    """Global rotations (N, 24, 3, 3) of SMPL pose vectors (N, 72)."""
    local = Rotation.from_rotvec(np.array(poses, dtype=np.float64).reshape(-1, 3)).as_matrix()
    return globals_from_locals(PARENTS, local.reshape(-1, 24, 3, 3))


def reference_joints(
    poses: np.ndarray, trans: np.ndarray, *, leg_length_m: float = REFERENCE_LEG_LENGTH_M
) -> tuple[np.ndarray, np.ndarray]:
    """Pose the reference skeleton.

    Args:
        poses: (N, 72) radians, root turn to the Z-up world included.
        trans: (N, 3) root joint in metres.
        leg_length_m: size of the skeleton.

    Returns:
        Joint positions (N, 24, 3) in metres and global rotations (N, 24, 3, 3).
    """
    rotations = globals_from_poses(poses)
    offsets = REFERENCE_OFFSETS * (leg_length_m / REFERENCE_LEG_LENGTH_M)
    return chain(PARENTS, rotations, offsets[None]) + np.asarray(trans)[:, None], rotations


def rotation_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Smallest rotation (3, 3) that turns direction `start` (3,) onto `end` (3,)."""
    start, end = unit(start), unit(end)
    axis, cosine = np.cross(start, end), float(start @ end)
    if cosine < -1 + 1e-9:  # opposite: half a turn about any axis across
        axis = unit(np.cross(start, np.eye(3)[np.argmin(np.abs(start))]))
        return Rotation.from_rotvec(np.pi * axis).as_matrix()
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def unit(vector: np.ndarray) -> np.ndarray:
    """A vector (3,) of length 1, or of length 0 as it is."""
    return vector / max(np.linalg.norm(vector), 1e-12)
