"""AMASS and other `.npz` files of SMPL, SMPL-H and SMPL-X pose vectors."""

from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.motions.motion import Motion, check_motion
from drapeline.motions.skeleton import REFERENCE_LEG_LENGTH_M
from drapeline.storage import load_npz

POSE_SIZES = {72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "fps")
RATES = {f"{key}?": "number|nan ..." for key in RATE_KEYS}
# SMPL's translation moves the whole model, whose root joint lies here at rest (mean shape, Y up).
# It turns about that joint, so this vector stays as it is whatever the pose.
_ROOT_JOINT_M = np.array([0.0, -0.22, 0.03])
_SMPL_LEG_LENGTH_M = 0.79  # mean shape, hip to knee to ankle


def read_amass(path: str | Path) -> Motion:
    """Read an AMASS motion at its own frame rate, in its own Z-up world.

    The 22 body joints are shared by the three models. SMPL's two hand joints are kept from 72
    numbers and left straight for SMPL-H and SMPL-X, whose fingers have no counterpart. The
    subject's leg length is not known without the licensed body model: the mean one stands in
    for it, and the motion is set on the floor afterwards.

    Raises:
        InputError: names the file, the key and what was expected.
    """
    # Stage-II files of SMPL-X also hold pickled markers, which are neither needed nor opened.
    forms = {"poses": "number|nan ...", "trans": "number|nan ...", **RATES}
    arrays = load_npz(path, forms)
    poses, trans = np.asarray(arrays["poses"]), np.asarray(arrays["trans"], dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] not in POSE_SIZES:
        sizes = ", ".join(f"{size} ({model})" for size, model in POSE_SIZES.items())
        raise InputError(f"{path}: poses of shape {poses.shape}, expected (frames, N) of {sizes}")
    full = np.zeros((len(poses), 72))
    kept = 72 if poses.shape[1] == 72 else 66
    full[:, :kept] = poses[:, :kept]
    scale = REFERENCE_LEG_LENGTH_M / _SMPL_LEG_LENGTH_M
    motion = Motion(
        full,
        (trans + _ROOT_JOINT_M) * scale if trans.shape == (len(poses), 3) else trans,
        frame_rate(path, arrays),
        "",
        "",
        str(path),
        Path(path).stem,
    )
    return check_motion(motion)


def frame_rate(path: str | Path, arrays: dict[str, np.ndarray]) -> float:
    """Frames per second from whichever key the file has."""
    for key in RATE_KEYS:
        if key in arrays:
            if arrays[key].size != 1:
                raise InputError(
                    f"{path}: '{key}' has shape {arrays[key].shape}, expected a number"
                )
            return float(arrays[key].item())
    raise InputError(f"{path}: has no frame rate, expected one of {', '.join(RATE_KEYS)}")
