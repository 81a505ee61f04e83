"""Recreate the clips of this folder from the DeepMimic clips of a pybullet wheel.

pip download --no-deps pybullet==3.2.7
python workflow/resources/motions/make_clips.py pybullet-3.2.7-*.whl
"""

import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError, refuse_damage
from drapeline.frames import FPS, JOINT_NAMES
from drapeline.motions.floor import set_on_floor
from drapeline.motions.joint_map import BUILT_IN, load_joint_map
from drapeline.motions.motion import Motion, close_cycle, interpolate, resampled_count, save_motion
from drapeline.motions.retarget import retarget
from drapeline.motions.skeleton import Take, chain, globals_from_locals
from drapeline.storage import atomic_file, read_json

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


TRUSTED_FLEXION_RAD = np.radians(30.0)  # from here on the captured twist is kept
_SMOOTH_S = 0.13


def steady_upper_arms(poses: np.ndarray, *, fps: float, cyclic: bool) -> np.ndarray:
    """Smooth the twist of upper arms in time as far as the elbow is straight.

    Args:
        poses: (N, 72) radians.
        cyclic: whether the last frame is followed by the first.

    Returns:
        Poses (N, 72) with other shoulder rotations. Upper arms point where they did; a forearm
        moves by no more than its small angle to the upper arm allows.
    """
    out = np.array(poses, dtype=np.float64).reshape(-1, 24, 3)
    mode = "wrap" if cyclic else "nearest"
    for side in ("left", "right"):
        shoulder, elbow = (JOINT_NAMES.index(f"{side}_{part}") for part in ("shoulder", "elbow"))
        turn = Rotation.from_rotvec(out[:, shoulder])
        flexion = np.linalg.norm(out[:, elbow], axis=1)
        trust = np.clip(flexion / TRUSTED_FLEXION_RAD, 0.0, 1.0) ** 2
        trust = gaussian_filter1d(trust, _SMOOTH_S * fps / 2, mode=mode)
        quat = turn.as_quat()
        twist = np.unwrap(2 * np.arctan2(quat[:, 0], quat[:, 3]))  # about X, the arm's direction
        smooth = gaussian_filter1d(twist, _SMOOTH_S * fps, mode=mode)
        change = np.zeros((len(out), 3))
        change[:, 0] = (1.0 - trust) * (smooth - twist)
        out[:, shoulder] = (turn * Rotation.from_rotvec(change)).as_rotvec()
    return out.reshape(-1, 72)


INSIDE_WHEEL = "pybullet_data/data/motions/humanoid3d_{name}.txt"


@dataclass(frozen=True)
class Clip:
    """One shipped clip: its name in the wheel and ours, its action label, how it repeats."""

    name: str
    action: str
    straight: bool = False


CLIPS = (
    Clip("walk", "walk", straight=True),
    Clip("run", "run", straight=True),
    Clip("jump", "jump"),
    Clip("dance_a", "dance"),
    Clip("dance_b", "dance"),
    Clip("crawl", "crawl", straight=True),
    Clip("cartwheel", "cartwheel"),
    Clip("backflip", "flip"),
    Clip("punch", "punch"),
    Clip("kick", "kick"),
    Clip("spin", "spin"),
    Clip("spinkick", "kick"),
    Clip("roll", "roll"),
    Clip("getup_facedown", "get up"),
    Clip("getup_faceup", "get up"),
)


def convert_clip(path: Path, clip: Clip) -> Motion:
    """A humanoid3d clip as a motion at 30 fps on the floor, one round if it is cyclic."""
    take, cyclic = read_deepmimic(path)
    poses, trans = retarget(take, load_joint_map(BUILT_IN / "deepmimic.yaml"))
    cycle = None
    if cyclic:
        poses, trans, cycle = close_cycle(
            poses, trans, take.times_s, fps=FPS, straight=clip.straight
        )
    else:
        count = resampled_count(2, 1.0 / take.times_s[-1])
        poses, trans = interpolate(poses, trans, take.times_s, np.arange(count) / FPS)
    poses = steady_upper_arms(poses, fps=FPS, cyclic=cyclic)
    motion = Motion(
        poses, trans, float(FPS), clip.action, "deepmimic", path.name, clip.name, cycle=cycle
    )
    return set_on_floor(motion)


def write_clips(wheel: Path, folder: Path) -> list[str]:
    """Convert every clip of a pybullet wheel and list them in `clips.tsv`.

    Returns:
        The table's lines.

    Raises:
        InputError: the wheel is missing, unreadable or lacks a clip.
    """
    lines = ["name\tfile\tframes\taction\tsubject\tsource\tloop"]
    try:
        with zipfile.ZipFile(wheel) as archive, tempfile.TemporaryDirectory() as scratch:
            for clip in CLIPS:
                inside = archive.extract(INSIDE_WHEEL.format(name=clip.name), scratch)
                motion = convert_clip(Path(inside), clip)
                save_motion(folder / f"{clip.name}.npz", motion)
                lines.append(
                    f"{clip.name}\t{clip.name}.npz\t{len(motion)}\t{motion.action}\t"
                    f"{motion.subject}\t{motion.source}\t{'no' if motion.cycle is None else 'yes'}"
                )
    except (FileNotFoundError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{wheel}: not a pybullet wheel with its clips ({error})") from error
    with atomic_file(folder / "clips.tsv") as path:
        path.write_text("\n".join(lines) + "\n")
    return lines


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: make_clips.py WHEEL")
    for line in write_clips(Path(sys.argv[1]), Path(__file__).parent):
        print(line)
