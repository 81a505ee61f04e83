"""Motions and motion files of known content, written by other means than the readers' own."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.motion import Motion
from drapeline.motions.skeleton import REFERENCE_OFFSETS

SMPL_TO_CMU_BVH = {
    "pelvis": "Hips",
    "spine1": "LowerBack",
    "spine2": "Spine",
    "spine3": "Spine1",
    "neck": "Neck",
    "head": "Head",
} | {
    f"{side}_{ours}": f"{side.title()}{theirs}"
    for side in ("left", "right")
    for ours, theirs in {
        "hip": "UpLeg",
        "knee": "Leg",
        "ankle": "Foot",
        "foot": "ToeBase",
        "collar": "Shoulder",
        "shoulder": "Arm",
        "elbow": "ForeArm",
        "wrist": "Hand",
        "hand": "Fingers",
    }.items()
}


def random_turns(rng: np.random.Generator, shape: tuple[int, ...], angle: float) -> np.ndarray:
    """Rotation matrices `shape` + (3, 3) of up to about `angle` radians."""
    vectors = rng.uniform(-angle, angle, (int(np.prod(shape)), 3))
    return Rotation.from_rotvec(vectors).as_matrix().reshape(*shape, 3, 3)


def smooth_turns(rng: np.random.Generator, frames: int, joints: int, angle: float) -> np.ndarray:
    """Local rotations (N, J, 3, 3) that change slowly from frame to frame."""
    phase = rng.uniform(0, 2 * np.pi, (joints, 3))
    time = np.linspace(0, 1.5, frames)[:, None, None]
    vectors = rng.uniform(-angle, angle, (joints, 3)) * np.sin(2 * np.pi * time + phase)
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(frames, joints, 3, 3)


def write_bvh(
    path: Path,
    local: np.ndarray,
    root: np.ndarray,
    *,
    names: tuple[str, ...] = tuple(SMPL_TO_CMU_BVH[name] for name in JOINT_NAMES),
    parents: np.ndarray = PARENTS,
    offsets: np.ndarray = REFERENCE_OFFSETS,
    order: str = "ZYX",
    frame_time: float = 1 / 30,
    decimals: int = 9,
) -> Path:
    """Write local rotations (N, J, 3, 3) and root positions (N, 3) as BVH."""
    sequence: list[int] = []
    lines = ["HIERARCHY", *_joint_lines(0, names, parents, offsets, order, sequence, "")]
    lines += ["MOTION", f"Frames: {len(local)}", f"Frame Time: {frame_time:.9f}"]
    turns = Rotation.from_matrix(local[:, sequence].reshape(-1, 3, 3))
    angles = turns.as_euler(order, degrees=True).reshape(len(local), -1)
    for row in np.concatenate([root, angles], axis=1):
        lines.append(" ".join(f"{value:.{decimals}f}" for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def _joint_lines(joint, names, parents, offsets, order, sequence, pad) -> list[str]:
    sequence.append(joint)
    turns = " ".join(f"{axis}rotation" for axis in order)
    moves = "6 Xposition Yposition Zposition" if joint == 0 else "3"
    lines = [
        f"{pad}{'ROOT' if joint == 0 else 'JOINT'} {names[joint]}",
        f"{pad}{{",
        f"{pad}\tOFFSET " + " ".join(f"{value:.9f}" for value in offsets[joint]),
        f"{pad}\tCHANNELS {moves} {turns}",
    ]
    children = np.flatnonzero(parents == joint)
    for child in children:
        lines += _joint_lines(child, names, parents, offsets, order, sequence, pad + "\t")
    if len(children) == 0:
        lines += [f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET 0 0.1 0", f"{pad}\t}}"]
    return [*lines, f"{pad}}}"]


DEEPMIMIC_HINGES = {"right_knee": 20, "left_knee": 34, "right_elbow": 29, "left_elbow": 43}


def deepmimic_frame(duration=1 / 60, x=0.0, **hinges):
    """A standing frame of a humanoid3d clip: hanging arms, root 0.85 m up."""
    row = np.zeros(44)
    row[0:4] = duration, x, 0.85, 0.0
    row[[4, 8, 12, 16, 21, 25, 30, 35, 39]] = 1.0  # quaternions, w first
    for name, angle in hinges.items():
        row[DEEPMIMIC_HINGES[name]] = angle
    return row.tolist()


def write_deepmimic(path, frames, loop="none"):
    """Write a humanoid3d clip; returns its path."""
    path.write_text(json.dumps({"Loop": loop, "Frames": frames}))
    return path


def standing_motion(frames=40, height=0.9, speed_m=0.0, **changes):
    """A motion that stands upright, its root at a height, and slides backwards."""
    poses = np.tile(np.concatenate([[np.pi / 2], np.zeros(71)]), (frames, 1))
    trans = np.zeros((frames, 3))
    trans[:, 1] = -speed_m * np.arange(frames)
    trans[:, 2] = height
    return Motion(poses, trans, 30.0, "", "", "a", "a", **changes)


# name: parent, direction, length, axis in degrees, degrees of freedom
BONES = {
    "lowerback": ("root", (0, 1, 0), 2, (0, 0, 0), "rx ry rz"),
    "upperback": ("lowerback", (0, 1, 0), 2, (0, 0, 0), "rx ry rz"),
    "thorax": ("upperback", (0, 1, 0), 2, (0, 0, 0), "rx ry rz"),
    "lowerneck": ("thorax", (0, 1, 0), 1.5, (0, 0, 0), "rx ry rz"),
    "head": ("lowerneck", (0, 1, 0), 2, (0, 0, 0), "rx ry rz"),
}
for side, sign in (("l", 1), ("r", -1)):
    slant = (0.34202 * sign, -0.939693, 0)
    BONES |= {
        f"{side}hipjoint": ("root", (0.6 * sign, -0.7, 0.3), 2.4, (0, 0, 0), ""),
        f"{side}femur": (f"{side}hipjoint", slant, 7.2, (0, 0, 20 * sign), "rx ry rz"),
        f"{side}tibia": (f"{side}femur", slant, 7.5, (0, 0, 20 * sign), "rx"),
        f"{side}foot": (
            f"{side}tibia",
            (0.06 * sign, -0.18, 0.98),
            2.3,
            (-90, 0, 20 * sign),
            "rx rz",
        ),
        f"{side}toes": (f"{side}foot", (0, 0, 1), 1.2, (-90, 0, 20 * sign), "rx"),
        f"{side}clavicle": ("thorax", (0.94 * sign, 0.33, 0), 3.6, (0, 0, 0), "ry rz"),
        f"{side}humerus": (
            f"{side}clavicle",
            (sign, 0, 0),
            5,
            (180, -30 * sign, -90 * sign),
            "rx ry rz",
        ),
        f"{side}radius": (f"{side}humerus", (sign, 0, 0), 3, (180, -30 * sign, -90 * sign), "rx"),
        f"{side}wrist": (f"{side}radius", (sign, 0, 0), 1.5, (180, -30 * sign, -90 * sign), "ry"),
    }


def asf_text():
    """A skeleton with the names and proportions of CMU's."""
    lines = [
        ":version 1.10",
        ":units",
        "  mass 1.0",
        "  length 0.45",
        "  angle deg",
        ":root",
        "   order TX TY TZ RX RY RZ",
        "   axis XYZ",
        "   position 0 0 0",
        "   orientation 0 0 0",
        ":bonedata",
    ]
    for number, (name, (_, direction, length, axis, freedom)) in enumerate(BONES.items(), 1):
        lines += ["begin", f"id {number}", f"name {name}"]
        lines += ["direction " + " ".join(map(str, direction)), f"length {length}"]
        lines += ["axis " + " ".join(map(str, axis)) + " XYZ"]
        lines += [f"dof {freedom}", "limits (-180 180)"] if freedom else []
        lines += ["end"]
    lines += [":hierarchy", "begin"]
    for parent in ["root", *BONES]:
        children = [name for name, bone in BONES.items() if bone[0] == parent]
        if children:
            lines.append(" ".join([parent, *children]))
    return "\n".join([*lines, "end"]) + "\n"


def amc_text(frames):
    """A motion of it; each frame names the bones that are not at rest."""
    lines = [":FULLY-SPECIFIED", ":DEGREES"]
    for number, frame in enumerate(frames, 1):
        lines.append(str(number))
        values = {"root": [0, 17, 0, 0, 0, 0]}
        values |= {name: [0] * len(bone[4].split()) for name, bone in BONES.items() if bone[4]}
        values |= frame
        lines += [f"{name} " + " ".join(map(str, row)) for name, row in values.items()]
    return "\n".join(lines) + "\n"
