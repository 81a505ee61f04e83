"""The humanoid3d clips of DeepMimic, as the pybullet wheel has them (JSON in .txt files)."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError, refuse_damage
from drapeline.motions.skeleton import Take, chain, globals_from_locals
from drapeline.storage import read_json

# X ahead, Y up, Z right; metres. Joint: parent, offset. Sizes of pybullet's humanoid.urdf,
# which is four times life size, divided by four.
_JOINTS = {
    "root": (-1, (0.0, 0.0, 0.0)),
    "chest": (0, (0.0, 0.236151, 0.0)),
    "neck": (1, (0.0, 0.223894, 0.0)),
    "right_hip": (0, (0.0, 0.0, 0.084887)),
    "right_knee": (3, (0.0, -0.421546, 0.0)),
    "right_ankle": (4, (0.0, -0.40987, 0.0)),
    "right_shoulder": (1, (-0.02405, 0.2435, 0.18311)),
    "right_elbow": (6, (0.0, -0.274788, 0.0)),
    "left_hip": (0, (0.0, 0.0, -0.084887)),
    "left_knee": (8, (0.0, -0.421546, 0.0)),
    "left_ankle": (9, (0.0, -0.40987, 0.0)),
    "left_shoulder": (1, (-0.02405, 0.2435, -0.18311)),
    "left_elbow": (11, (0.0, -0.274788, 0.0)),
    "right_wrist": (7, (0.0, -0.258947, 0.0)),
    "left_wrist": (12, (0.0, -0.258947, 0.0)),
}
_HINGES = ("right_knee", "right_elbow", "left_knee", "left_elbow")  # one angle about Z
_FIXED = ("right_wrist", "left_wrist")
FRAME_SIZE = 44


def read_deepmimic(path: str | Path) -> tuple[Take, bool]:
    """Read a humanoid3d clip.

    Args:
        path: JSON file with "Loop" and "Frames": duration in seconds, root position, root
            quaternion (w first), then a quaternion per joint, or an angle for knees and elbows.

    Returns:
        The take, and whether the clip is a cycle whose last frame repeats its first elsewhere.

    Raises:
        InputError: the file is missing, unreadable or of another layout.
    """
    path = Path(path)
    with refuse_damage(path, "a DeepMimic clip"):
        content = read_json(path, {"Frames": [[float]]})
        frames = np.array(content["Frames"], dtype=np.float64)
    if frames.ndim != 2 or frames.shape[1] != FRAME_SIZE or len(frames) < 2:
        raise InputError(
            f"{path}: frames of shape {frames.shape}, expected (2 or more, {FRAME_SIZE})"
        )
    names, parents = tuple(_JOINTS), np.array([parent for parent, _ in _JOINTS.values()])
    offsets = np.array([offset for _, offset in _JOINTS.values()])
    with refuse_damage(path, "a DeepMimic clip"):  # quaternions of length zero
        rotations = globals_from_locals(parents, _local_rotations(frames))
    positions = chain(parents, rotations, offsets[None]) + frames[:, None, 1:4]
    # A frame's duration is the time until the next one.
    times = np.concatenate([[0.0], np.cumsum(frames[:-1, 0])])
    take = Take(str(path), names, parents, offsets, rotations, positions, times)
    return take, content.get("Loop") == "wrap"


def _local_rotations(frames: np.ndarray) -> np.ndarray:
    """(N, 15, 3, 3) local rotations of the joints in `_JOINTS`' order."""
    local = np.zeros((len(frames), len(_JOINTS), 3, 3))
    column = 4
    for joint, name in enumerate(_JOINTS):
        if name in _FIXED:
            local[:, joint] = np.eye(3)
        elif name in _HINGES:
            axis_angle = frames[:, column, None] * np.array([0.0, 0.0, 1.0])
            local[:, joint] = Rotation.from_rotvec(axis_angle).as_matrix()
            column += 1
        else:
            wxyz = frames[:, column : column + 4]
            local[:, joint] = Rotation.from_quat(np.roll(wxyz, -1, axis=1)).as_matrix()
            column += 4
    return local
