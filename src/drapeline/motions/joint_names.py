"""Joints of a person, found by their names in any program's spelling and by the tree's shape."""

import re
from collections.abc import Sequence
from itertools import pairwise

from drapeline.motions.skeleton import Take

_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_PREFIXES = ("bip", "biped", "joint", "jnt", "def", "bone", "mixamorig", "character")
_SHINS = ("shin", "calf", "lowerleg", "lowleg", "tibia", "knee")
# SMPL's part of a limb -> words of programs, the surest first. A joint that has one part has no
# other: a "foot" is the ankle, but the toes beside an "ankle".
_WORDS = {
    "hip": ("thigh", "upleg", "upperleg", "femur", "hip", "leg"),
    "knee": (*_SHINS, "leg"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "toe0", "ball", "foot"),
    "shoulder": ("upperarm", "uparm", "humerus", "shldr", "arm", "shoulder"),
    "collar": ("collar", "clavicle", "shoulder"),
    "elbow": ("forearm", "lowerarm", "lowarm", "elbow", "radius"),
    "wrist": ("wrist", "hand"),
}
_CHAINS = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))


def name_joints(take: Take) -> dict[str, str]:
    """SMPL joint to source joint, or nothing where two legs and two arms are not found by name.

    Limbs are found by the words of their names; the pelvis is where the legs meet, the chest where
    the arms do, and the spine is what lies between.
    """
    words = {index: _side_and_word(name) for index, name in enumerate(take.names)}
    found: dict[str, int] = {}
    for side in ("left", "right"):
        of_side: dict[str, int] = {}
        for index, (its_side, word) in words.items():
            if its_side == side:
                of_side.setdefault(word, index)
        found |= {f"{side}_{part}": index for part, index in _limbs(of_side).items()}
        for chain in _CHAINS:
            if not _descend(take, [found.get(f"{side}_{part}", -1) for part in chain]):
                return {}
    pelvis = _meeting(take, found["left_hip"], found["right_hip"])
    chest = _meeting(take, found["left_shoulder"], found["right_shoulder"])
    if pelvis < 0 or chest < 0:
        return {}
    above = ancestors(take, pelvis)
    spine = [index for index in ancestors(take, chest)[::-1] if index not in above]
    found |= {"pelvis": pelvis, **spine_levels(spine)}
    for name in ("neck", "head"):
        for index, (side, word) in words.items():
            if not side and word.rstrip("01") == name and name not in found:
                found[name] = index
    return {joint: take.names[index] for joint, index in found.items()}


def _side_and_word(name: str) -> tuple[str, str]:
    """Side ("" for none) and the other words of a joint's name, small and in one."""
    name = name.rsplit(":", 1)[-1]
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]
    while len(words) > 1 and (words[0] in _PREFIXES or words[0].isdecimal()):
        words = words[1:]
    for side in ("left", "right"):
        if words and words[0] != side and words[0].startswith(side):  # "leftupleg"
            words = [side, words[0].removeprefix(side), *words[1:]]
    sides = [word for word in words if word in _SIDES]
    if len(sides) > 1:
        return "", ""
    rest = "".join(word for word in words if word not in _SIDES)
    return (_SIDES[sides[0]] if sides else ""), rest


def _limbs(of_side: dict[str, int]) -> dict[str, int]:
    """Joint by SMPL's part of one side's limbs."""
    found: dict[str, int] = {}
    for part, words in _WORDS.items():
        for word in words:
            index = of_side.get(word)
            if index is None or index in found.values():
                continue
            if (part, word) == ("hip", "leg") and not of_side.keys() & set(_SHINS):
                continue  # the shin, as no other joint is
            found[part] = index
            break
    return found


def spine_levels(spine: Sequence[int]) -> dict[str, int]:
    """SMPL's three spine joints among those from the pelvis, without it, to the chest."""
    if len(spine) > 3:
        spine = [spine[0], spine[len(spine) // 2], spine[-1]]
    names: dict[int, tuple[str, ...]] = {0: (), 1: ("spine3",), 2: ("spine1", "spine3")}
    levels = names.get(len(spine), ("spine1", "spine2", "spine3"))
    return dict(zip(levels, spine, strict=True))


def ancestors(take: Take, joint: int) -> list[int]:
    """A joint and those above it, up to the root."""
    above = [joint]
    while take.parents[above[-1]] >= 0:
        above.append(int(take.parents[above[-1]]))
    return above


def _meeting(take: Take, first: int, second: int) -> int:
    """The lowest joint that is above both, or -1."""
    above = set(ancestors(take, second)[1:])
    return next((joint for joint in ancestors(take, first)[1:] if joint in above), -1)


def _descend(take: Take, joints: Sequence[int]) -> bool:
    """Whether the joints are all there and each hangs from the one before."""
    return min(joints) >= 0 and all(
        upper in ancestors(take, lower)[1:] for upper, lower in pairwise(joints)
    )
