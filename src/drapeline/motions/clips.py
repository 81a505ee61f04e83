"""The clips that ship with the workflow, converted from the pybullet wheel's DeepMimic clips."""

import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.motions.arms import steady_upper_arms
from drapeline.motions.deepmimic import read_deepmimic
from drapeline.motions.grounding import set_on_floor
from drapeline.motions.joint_map import BUILT_IN, load_joint_map
from drapeline.motions.looping import close_cycle
from drapeline.motions.motion import Motion, interpolate, resampled_count, save_motion
from drapeline.motions.retarget import retarget
from drapeline.storage import atomic_file

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
