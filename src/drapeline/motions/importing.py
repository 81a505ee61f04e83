"""Import of motion files of all formats, AMASS's here, and the number of frames they will have."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.motions.asf_amc import CMU_FPS, amc_frames, find_asf, read_asf_amc
from drapeline.motions.bvh import bvh_frames, read_bvh
from drapeline.motions.conventions import explain_poses, explain_take
from drapeline.motions.floor import set_on_floor
from drapeline.motions.joint_map import UNITS_M, JointMap, built_in_map, load_joint_map
from drapeline.motions.motion import (
    Motion,
    check_motion,
    interpolate,
    load_motion,
    loop_to,
    resample,
    resampled_count,
)
from drapeline.motions.retarget import retarget
from drapeline.motions.skeleton import REFERENCE_LEG_LENGTH_M, Take
from drapeline.motions.variation import cut_piece
from drapeline.storage import load_npz

POSE_SIZES = {72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "fps")
RATES = {f"{key}?": "number|nan ..." for key in RATE_KEYS}
# SMPL's translation moves the whole model, whose root joint lies here at rest (mean shape, Y up).
# It turns about that joint, so this vector stays as it is whatever the pose.
_ROOT_JOINT_M = np.array([0.0, -0.22, 0.03])
_SMPL_LEG_LENGTH_M = 0.79  # mean shape, hip to knee to ankle


def read_amass(path: str | Path, joint_map: JointMap | None = None) -> Motion:
    """Read an AMASS motion at its own frame rate, in a Z-up world.

    AMASS's own files are Z-up; others that are not are turned (`explain_poses`), as `up` and `unit`
    of a joint map say or as the motion shows.

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
    fps = frame_rate(path, arrays)
    scale = REFERENCE_LEG_LENGTH_M / _SMPL_LEG_LENGTH_M
    if trans.shape == (len(poses), 3):
        unit_m = UNITS_M[(joint_map and joint_map.unit) or "m"]
        trans = (trans * unit_m + _ROOT_JOINT_M) * scale
    name = str(path)
    motion = check_motion(Motion(full, trans, fps, "", "", name, Path(path).stem))
    full, trans = explain_poses(full, trans, fps, joint_map, name)
    return replace(motion, poses=full, trans=trans)


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


_MIN_FPS, _MAX_FPS = 1.0, 10_000.0


class _Format(NamedTuple):
    """A format of motion files.

    Attributes:
        read: (path, joint map or None, skeleton file or None, frames per second where the file
            does not tell) -> a motion in SMPL's pose space, on the floor; or a take, and its frames
            per second.
        measure: (path, frames per second) -> frames, frames per second, and whether it is cyclic,
            without reading the whole file.
    """

    read: Callable[[Path, JointMap | None, str | Path | None, float], Motion | tuple[Take, float]]
    measure: Callable[[Path, float], tuple[int, float, bool]]


def import_motion(
    path: str | Path,
    *,
    joint_map: str | Path | None = None,
    asf: str | Path | None = None,
    amc_fps: float = CMU_FPS,
    start_s: float = 0.0,
    end_s: float | None = None,
    frames: int | None = None,
    lock_feet: bool = True,
    action: str = "",
    subject: str = "",
    sequence: str = "",
) -> Motion:
    """Read any supported motion file as SMPL poses at 30 fps on the floor.

    Args:
        path: `.npz` (ours or AMASS), `.bvh`, `.amc`, or `.fbx` where bpy is installed.
        joint_map: YAML joint map: the joints of a BVH or AMC skeleton, and the vertical axis and
            unit of any file; None tries the built-in ones and measures the rest.
        asf: skeleton of an AMC motion; None looks beside it.
        amc_fps: frames per second of an AMC motion; the file does not tell.
        start_s, end_s: the part of the file that is kept; None for its end. How the file is to be
            read is measured from all of it.
        frames: length of the result: cyclic clips are repeated up to it, longer motions are
            cut, and shorter ones stay as they are. None keeps the whole motion.
        lock_feet: whether the legs of a BVH or AMC motion are bent so that resting feet neither
            slide nor float; other files' legs are never bent.
        action, subject, sequence: labels; where empty, the file's own or its name are used.

    Raises:
        InputError: one sentence naming the file, the value and what was expected.
    """
    path = _check_suffix(path)
    given = None if joint_map is None else load_joint_map(joint_map)
    found = _FORMATS[path.suffix.lower()].read(path, given, asf, amc_fps)
    if isinstance(found, Motion):
        motion = found
        kept = _kept(path, len(motion), start_s, end_s)
        if kept != range(len(motion)):
            motion = cut_piece(motion, kept.start, kept.stop)
    else:
        take, fps = found
        poses, trans = retarget(*explain_take(take, _map_for(take, given)))
        _check_rate(path, fps)
        kept = _kept(path, resampled_count(len(poses), fps), start_s, end_s)
        times = np.arange(kept.start, kept.stop) / FPS
        poses, trans = interpolate(poses, trans, take.times_s, times)
        motion = Motion(poses, trans, float(FPS), "", "", str(path), path.stem)
        motion = set_on_floor(motion, feet=lock_feet)
    if frames is not None:
        motion = loop_to(motion, frames)
        motion = replace(motion, poses=motion.poses[:frames], trans=motion.trans[:frames])
    check_motion(replace(motion, source=str(path)))
    return replace(
        motion,
        source=path.name if motion.source == str(path) else motion.source,
        action=action or motion.action,
        subject=subject or motion.subject or _subject(path),
        sequence=sequence or motion.sequence,
    )


def read_take(
    path: str | Path,
    *,
    joint_map: str | Path | None = None,
    asf: str | Path | None = None,
    amc_fps: float = CMU_FPS,
) -> tuple[Take, JointMap]:
    """Read a BVH, AMC or FBX file as it is, and the joints that are found in it.

    Args:
        path, joint_map, asf, amc_fps: as `import_motion` takes them.

    Raises:
        InputError: as `import_motion`, or the file has poses of SMPL and no skeleton of its own.
    """
    path = _check_suffix(path)
    given = None if joint_map is None else load_joint_map(joint_map)
    found = _FORMATS[path.suffix.lower()].read(path, given, asf, amc_fps)
    if isinstance(found, Motion):
        raise InputError(f"{path}: holds SMPL poses, expected a file with a skeleton of its own")
    take, _ = found
    return take, _map_for(take, given)


def _map_for(take: Take, given: JointMap | None) -> JointMap:
    """The map that is given; its joints are a built-in map's if it names none."""
    if given is None:
        return built_in_map(take)
    return given if given.joints else replace(given, joints=built_in_map(take).joints)


def _kept(path: Path, count: int, start_s: float, end_s: float | None) -> range:
    """Frames at 30 per second of a file with `count` of them that lie between two times."""
    length_s = count / FPS
    first = round(start_s * FPS)
    if not 0 <= first < count:
        raise InputError(f"{path}: start_s is {start_s:g}, expected 0 to less than {length_s:.4g}")
    if end_s is None:
        return range(first, count)
    last = round(end_s * FPS)
    if not first < last <= count:
        raise InputError(
            f"{path}: end_s is {end_s:g}, expected more than {start_s:g} and at most {length_s:.4g}"
        )
    return range(first, last)


def frame_count(
    path: str | Path,
    *,
    frames: int | None = None,
    amc_fps: float = CMU_FPS,
    start_s: float = 0.0,
    end_s: float | None = None,
) -> int:
    """Frames that `import_motion` would return, without reading the whole file.

    Raises:
        InputError: the file is missing, of an unknown format, or its header is unreadable.
    """
    path = _check_suffix(path)
    count, fps, cyclic = _FORMATS[path.suffix.lower()].measure(path, amc_fps)
    _check_rate(path, fps)
    whole = resampled_count(count, fps)
    count = len(_kept(path, whole, start_s, end_s))
    if frames is None:
        return count
    cyclic = cyclic and count == whole  # a part of a round is none
    return frames if cyclic else min(count, frames)


def _check_suffix(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix.lower() not in _FORMATS:
        raise InputError(
            f"{path}: '{path.suffix}' is no known motion, expected {', '.join(_FORMATS)}"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a motion")
    return path


def _read_npz(path: Path, given: JointMap | None) -> Motion:
    """Read our own file, recognised by its leg length, or else an AMASS file."""
    ours = load_npz(path, {"reference_leg_length_m?": "any ..."})
    motion = load_motion(path) if ours else read_amass(path, given)
    _check_rate(path, motion.fps)
    motion = resample(motion)
    # AMASS is in SMPL's pose space already, so its poses are kept.
    return motion if ours else set_on_floor(motion, feet=False, hands=False)


def _check_rate(path: Path, fps: float) -> None:
    """No recording is slower or faster; what is makes motions without end or without frames."""
    if not _MIN_FPS <= fps <= _MAX_FPS:
        raise InputError(
            f"{path}: {fps:g} frames per second, expected {_MIN_FPS:g} to {_MAX_FPS:g}"
        )


def _npz_frames(path: Path) -> tuple[int, float, bool]:
    """Frames, frames per second, and whether it is cyclic, from the array headers."""
    forms = {"poses": "number ...", "cycle_turn_rad?": "number", **RATES}
    arrays = load_npz(path, forms, unread=["poses"])
    shape, fps = arrays["poses"].shape, frame_rate(path, arrays)
    if not shape or shape[0] < 1:
        raise InputError(f"{path}: poses of shape {shape}, expected at least 1 frame")
    return shape[0], fps, "cycle_turn_rad" in arrays


def _rate(times_s: np.ndarray) -> float:
    """Frames per second of evenly spaced frames."""
    return 1.0 / float(times_s[1] - times_s[0]) if len(times_s) > 1 else float(FPS)


def _read_bvh(path: Path) -> tuple[Take, float]:
    take = read_bvh(path)
    return take, _rate(take.times_s)


@contextmanager
def _as_bvh(path: Path) -> Iterator[Path]:
    """An FBX file as BVH, by Blender in a process of its own, while the block lasts."""
    with TemporaryDirectory() as folder:
        target = Path(folder, f"{path.stem}.bvh")
        command = [sys.executable, "-m", "drapeline.blender.fbx", str(path), str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if not target.is_file():
            lines = done.stderr.strip().splitlines() or ["Blender ended without a word"]
            if "No module named 'bpy'" in lines[-1]:
                raise InputError(
                    f"{path}: FBX needs Blender, the package bpy, expected it installed, or BVH"
                )
            words = lines[-1] if str(path) in lines[-1] else f"{path}: {lines[-1]}"
            raise InputError(words)
        yield target


def _read_fbx(path: Path) -> tuple[Take, float]:
    with _as_bvh(path) as converted:
        take, fps = _read_bvh(converted)
    return replace(take, source=str(path)), fps


def _fbx_frames(path: Path) -> tuple[int, float, bool]:
    with _as_bvh(path) as converted:
        return *bvh_frames(converted), False


def _read_amc(
    path: Path, _: JointMap | None, asf: str | Path | None, fps: float
) -> tuple[Take, float]:
    return read_asf_amc(asf or find_asf(path), path, fps=fps), fps


_FORMATS = {
    ".npz": _Format(
        lambda path, given, *_: _read_npz(path, given), lambda path, _: _npz_frames(path)
    ),
    ".bvh": _Format(lambda path, *_: _read_bvh(path), lambda path, _: (*bvh_frames(path), False)),
    ".fbx": _Format(lambda path, *_: _read_fbx(path), lambda path, _: _fbx_frames(path)),
    ".amc": _Format(_read_amc, lambda path, fps: (amc_frames(path), fps, False)),
}


def _subject(path: Path) -> str:
    """The subject in a CMU file name such as ``01_02`` or ``cmu_12_01_walk``."""
    numbers = [part for part in path.stem.split("_") if part.isdigit()]
    return numbers[0] if len(numbers) >= 2 else ""
