"""Acclaim skeletons and motions (.asf and .amc), the CMU database's own format."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError, refuse_damage
from drapeline.motions.skeleton import Take, chain, globals_from_locals

_FRAME_NUMBER = re.compile(rb"\s*\d{1,18}\s*(#.*\s*)?")
_HUGE = 1e9  # no angle and no place of a skeleton; beyond, turns come out as nothing
CMU_FPS = 120.0  # AMC files do not tell their frame rate


@dataclass
class _Bone:
    """A bone of the skeleton; its joint is where it starts, its parent's end."""

    name: str = ""
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    vector: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis: Rotation = field(default_factory=Rotation.identity)
    order: str = "xyz"
    degrees_of_freedom: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Skeleton:
    bones: dict[str, _Bone]
    parents: dict[str, str]
    in_degrees: bool


def find_asf(amc: str | Path) -> Path:
    """The skeleton beside a motion: ``01_02.amc`` belongs to ``01.asf``.

    Raises:
        InputError: none or several could be meant.
    """
    amc = Path(amc)
    beside = sorted(amc.parent.glob("*.asf"))
    for stem in (amc.stem, amc.stem.split("_")[0]):
        for candidate in beside:
            if candidate.stem == stem:
                return candidate
    if len(beside) == 1:
        return beside[0]
    raise InputError(
        f"{amc}: no {amc.stem.split('_')[0]}.asf beside it, expected its skeleton there or as 'asf'"
    )


def read_asf_amc(asf: str | Path, amc: str | Path, *, fps: float = CMU_FPS) -> Take:
    """Read a motion on its skeleton.

    Args:
        fps: frames per second of the motion.

    Returns:
        The take, in the skeleton's unit of length (CMU: 1/0.45 inches); retargeting brings it to
        metres by the length of the legs.

    Raises:
        InputError: names the file and what is missing, cut off or not a number.
    """
    asf, amc = Path(asf), Path(amc)
    skeleton = _parse_asf(asf, _lines(asf, "an ASF skeleton"))
    names = ["root"]  # parents before children, whatever the file's order
    for parent in names:
        names += [child for child, above in skeleton.parents.items() if above == parent]
    parents = np.array([-1] + [names.index(skeleton.parents[name]) for name in names[1:]])
    if len(names) < len(skeleton.bones):
        lost = sorted(set(skeleton.bones) - set(names))
        raise InputError(f"{asf}: bone {lost[0]} hangs from nothing, expected a tree from the root")
    frames = _parse_amc(amc, _lines(amc, "an AMC motion"), skeleton, asf)
    count = len(next(iter(frames.values())))
    local = np.zeros((count, len(names), 3, 3))
    for joint, name in enumerate(names):
        local[:, joint] = _local_rotation(skeleton, skeleton.bones[name], frames.get(name), count)
    rotations = globals_from_locals(parents, local)
    offsets = np.array(
        [np.zeros(3)] + [skeleton.bones[names[parent]].vector for parent in parents[1:]]
    )
    root = np.zeros((count, 3))
    for column, channel in enumerate(skeleton.bones["root"].degrees_of_freedom):
        if channel.startswith("t"):
            root[:, "xyz".index(channel[1])] = frames["root"][:, column]
    positions = chain(parents, rotations, offsets[None]) + root[:, None]
    return Take(
        str(amc), tuple(names), parents, offsets, rotations, positions, np.arange(count) / fps
    )


def amc_frames(path: str | Path) -> int:
    """Number of frames of an AMC file, from its lines that number frames.

    Raises:
        InputError: the file is missing, has no frame, or its numbers skip or repeat.
    """
    path = Path(path)
    count = number = 0
    with refuse_damage(path, "an AMC motion"), open(path, "rb") as stream:
        for line in stream:
            if _FRAME_NUMBER.fullmatch(line):
                number = _follow(path, number if count else None, int(line.split(b"#")[0]))
                count += 1
    if count == 0:
        raise InputError(f"{path}: holds 0 frames, expected at least 1")
    return count


def _follow(path: Path, previous: int | None, number: int) -> int:
    """The number of a frame, if it is the one after the previous frame's.

    Raises:
        InputError: frames are missing or there twice, so that nobody knows when each was.
    """
    if previous is not None and number != previous + 1:
        raise InputError(
            f"{path}: frame {number} follows frame {previous}, expected {previous + 1} (none "
            "missing and none twice; number them 1, 2, 3 ... and give their rate as 'amc_fps')"
        )
    return number


def _lines(path: Path, expected: str) -> list[list[str]]:
    with refuse_damage(path, expected):
        raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:  # names of an older Western program
        text = raw.decode("latin-1")
    rows = (line.split("#")[0].split() for line in text.replace("\r", "\n").split("\n"))
    return [row for row in rows if row]


def _parse_asf(path: Path, lines: list[list[str]]) -> _Skeleton:
    bones = {"root": _Bone("root")}
    parents: dict[str, str] = {}
    in_degrees, section, bone = True, "", _Bone()
    with refuse_damage(path, "ASF"):
        for words in lines:
            key = words[0].lower()
            if key.startswith(":"):
                section = key
            elif section == ":units" and key == "angle":
                in_degrees = words[1].lower().startswith("deg")
            elif section == ":root":
                _parse_root_line(bones["root"], words, in_degrees)
            elif section == ":bonedata" and key == "begin":
                bone = _Bone()
            elif section == ":bonedata" and key == "end":
                bone.vector = bone.direction / np.linalg.norm(bone.direction) * bone.length
                bones[bone.name] = bone
            elif section == ":bonedata":
                _parse_bone_line(bone, words, in_degrees)
            elif section == ":hierarchy" and key not in ("begin", "end"):
                parents.update(dict.fromkeys(words[1:], words[0]))
    strange = sorted({*parents, *parents.values()} - set(bones))
    if strange or not parents or set(bones) - {"root"} != set(parents):
        listed = ", ".join(strange or sorted((set(bones) - {"root"}) ^ set(parents)) or ["none"])
        raise InputError(f"{path}: bones and hierarchy disagree on {listed}, expected a whole ASF")
    for name, bone in bones.items():
        _check_bone(path, name, bone)
    return _Skeleton(bones, parents, in_degrees)


def _check_bone(path: Path, name: str, bone: _Bone) -> None:
    if bone.vector.shape != (3,) or not np.isfinite(bone.vector).all():
        raise InputError(
            f"{path}: bone {name} has no direction and length, expected finite numbers"
        )
    moves = [f"{kind}{axis}" for kind in "tr" for axis in "xyz"] + ["l"]
    strange = [word for word in bone.degrees_of_freedom if word not in moves]
    if strange or len(set(bone.degrees_of_freedom)) < len(bone.degrees_of_freedom):
        found = " ".join(bone.degrees_of_freedom)
        raise InputError(
            f"{path}: bone {name} moves in {found}, expected some of {' '.join(moves)}"
        )


def _parse_bone_line(bone: _Bone, words: list[str], in_degrees: bool) -> None:
    key = words[0].lower()
    if key == "name":
        bone.name = words[1]
    elif key == "direction":
        bone.direction = np.array(words[1:4], dtype=np.float64)
    elif key == "length":
        bone.length = float(words[1])
    elif key == "axis":
        bone.order = _order(words[4])
        bone.axis = Rotation.from_euler(bone.order, _angles(words[1:4]), degrees=in_degrees)
    elif key == "dof":
        bone.degrees_of_freedom = tuple(word.lower() for word in words[1:])


def _order(word: str) -> str:
    if sorted(word.lower()) != ["x", "y", "z"]:
        raise ValueError(f"axes '{word:.20}', expected an order of XYZ")
    return word.lower()


def _angles(words: list[str]) -> np.ndarray:
    angles = np.array(words, dtype=np.float64)
    if not (np.abs(angles) < _HUGE).all():
        raise ValueError(f"angles '{' '.join(words):.60}', expected finite numbers")
    return angles


def _parse_root_line(root: _Bone, words: list[str], in_degrees: bool) -> None:
    key = words[0].lower()
    if key == "order":
        root.degrees_of_freedom = tuple(word.lower() for word in words[1:])
    elif key == "axis":
        root.order = _order(words[1])
    elif key == "orientation":
        root.axis = Rotation.from_euler(root.order, _angles(words[1:4]), degrees=in_degrees)


def _parse_amc(
    path: Path, lines: list[list[str]], skeleton: _Skeleton, asf: Path
) -> dict[str, np.ndarray]:
    """Values (N, degrees of freedom) of each moving bone; `asf` is the skeleton's file."""
    rows: dict[str, list[list[float]]] = {
        name: [] for name, bone in skeleton.bones.items() if bone.degrees_of_freedom
    }
    frame, count = "", 0
    for words in lines:
        if words[0].startswith(":"):
            continue
        if len(words) == 1 and words[0].isdecimal() and len(words[0]) <= 18:
            _follow(path, int(frame) if count else None, int(words[0]))
            frame, count = words[0], count + 1
            continue
        name = words[0]
        if name not in rows:
            known = ", ".join(rows)
            raise InputError(
                f"{path}: frame {frame} moves bone {name}, expected one of {known}, which {asf} has"
            )
        try:
            values = [float(word) for word in words[1:]]
        except ValueError as error:
            raise InputError(f"{path}: frame {frame}, bone {name}: {error}") from error
        expected = len(skeleton.bones[name].degrees_of_freedom)
        if len(values) != expected or not (np.abs(values) < _HUGE).all():
            raise InputError(
                f"{path}: frame {frame}, bone {name} holds {' '.join(words[1:])}, "
                f"expected {expected} finite numbers by {asf}"
            )
        rows[name].append(values)
    if not rows:
        raise InputError(f"{path}: its skeleton has no bone that moves, expected at least the root")
    if count == 0:
        raise InputError(f"{path}: holds 0 frames, expected at least 1")
    short = [name for name, values in rows.items() if len(values) != count]
    if short:
        raise InputError(
            f"{path}: bone {short[0]} has {len(rows[short[0]])} values in {count} frames, "
            "expected one in each (is the file cut off?)"
        )
    return {name: np.array(values) for name, values in rows.items()}


def _local_rotation(
    skeleton: _Skeleton, bone: _Bone, values: np.ndarray | None, count: int
) -> np.ndarray:
    """(N, 3, 3) turn of a bone away from the rest pose: its angles, about its own axes."""
    if values is None:
        return np.repeat(np.eye(3)[None], count, axis=0)
    angles = np.zeros((count, 3))
    for column, channel in enumerate(bone.degrees_of_freedom):
        if channel.startswith("r"):
            angles[:, bone.order.index(channel[1])] = values[:, column]
    turn = Rotation.from_euler(bone.order, angles, degrees=skeleton.in_degrees)
    return (bone.axis * turn * bone.axis.inv()).as_matrix()
