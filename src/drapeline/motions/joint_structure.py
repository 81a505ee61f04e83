"""Joints of a person, found by the shape of the skeleton and the motion where names say nothing."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drapeline.motions.joint_names import ancestors, spine_levels
from drapeline.motions.skeleton import Take

_ALIKE = 0.06  # difference of bones that mirror one another, as a share
_LIMB_SHARE = 0.4  # of the longest pair's length; fingers, ears and skirts are shorter
_MOST_JOINTS = 300
_SURE = 0.75  # share of the frames that have to agree on which side is which


class _Pair(NamedTuple):
    """Two chains of joints from one parent that mirror one another."""

    parent: int
    chains: tuple[list[int], list[int]]
    length: float


def find_joints(take: Take) -> dict[str, str]:
    """SMPL joint to source joint, or nothing where the skeleton is not clearly that of a person.

    Two pairs of chains mirror one another: the legs, and the arms farther from the root, each with
    its two longest bones in a row. The left side is where it is for somebody whose toes, or else
    whose knees, point forwards.
    """
    pairs = _pairs(take) if len(take.names) <= _MOST_JOINTS else []
    if not pairs:
        return {}
    longest = max(pair.length for pair in pairs)
    pairs = [pair for pair in pairs if pair.length > _LIMB_SHARE * longest]
    if len(pairs) != 2:
        return {}
    above = [ancestors(take, pair.parent) for pair in pairs]
    if pairs[0].parent == pairs[1].parent:
        return {}
    if pairs[1].parent in above[0]:
        legs, arms = pairs[1], pairs[0]
    elif pairs[0].parent in above[1]:
        legs, arms = pairs[0], pairs[1]
    else:
        return {}
    parts = [
        (_limb(take, leg, ("hip", "knee", "ankle", "foot"), before=""), arm)
        for leg, arm in zip(legs.chains, _as_legs_lie(take, legs, arms), strict=True)
    ]
    sides = _sides(take, [leg for leg, _ in parts], legs.parent, arms.parent)
    if not sides:
        return {}
    found: dict[str, int] = {"pelvis": legs.parent}
    for side, (leg, arm) in zip(sides, parts, strict=True):
        arm_parts = _limb(take, arm, ("shoulder", "elbow", "wrist", "hand"), before="collar")
        found |= {f"{side}_{name}": joint for name, joint in {**leg, **arm_parts}.items()}
    spine = [j for j in ancestors(take, arms.parent)[::-1] if j not in ancestors(take, legs.parent)]
    found |= spine_levels(spine)
    found |= _neck(take, arms)
    return {joint: take.names[index] for joint, index in found.items()}


def _pairs(take: Take) -> list[_Pair]:
    """Chains of three bones and more from one parent that mirror one another."""
    found = []
    for parent in range(len(take.names)):
        children = _children(take, parent)
        for first, one in enumerate(children):
            for other in children[first + 1 :]:
                chains = _chain(take, one), _chain(take, other)
                lengths = [_bones(take, chain) for chain in chains]
                if len(lengths[0]) != len(lengths[1]) or len(lengths[0]) < 3:
                    continue
                whole = max(sum(lengths[0]), sum(lengths[1]))
                if max(map(abs, np.subtract(lengths[0], lengths[1]))) < _ALIKE * whole:
                    found.append(_Pair(parent, chains, whole))
    return found


def _children(take: Take, joint: int) -> list[int]:
    return np.flatnonzero(take.parents == joint).tolist()


def _reaches(take: Take) -> np.ndarray:
    """(J,) length of the longest way down to and below each joint, from the one above it."""
    bones = np.linalg.norm(take.offsets, axis=1)
    reach = bones.copy()
    for joint in range(len(bones) - 1, 0, -1):  # parents come before children
        parent = take.parents[joint]
        if parent >= 0:
            reach[parent] = max(reach[parent], bones[parent] + reach[joint])
    return reach


def _chain(take: Take, joint: int) -> list[int]:
    """A joint and those below it, along the longest way down."""
    chain, reach = [joint], _reaches(take)
    while children := _children(take, chain[-1]):
        chain.append(max(children, key=lambda child: reach[child]))
    return chain


def _bones(take: Take, chain: Sequence[int]) -> list[float]:
    """Distance of each joint of a chain from the one above."""
    return [float(np.linalg.norm(take.offsets[joint])) for joint in chain]


def _limb(take: Take, chain: Sequence[int], names: Sequence[str], *, before: str) -> dict[str, int]:
    """Names of the joints about the two longest bones in a row."""
    bones = _bones(take, chain)
    first = max(range(len(chain) - 2), key=lambda k: bones[k + 1] + bones[k + 2])
    found = dict(zip(names, chain[first:], strict=False))
    if before and first > 0:
        found[before] = chain[first - 1]
    return found


def _as_legs_lie(take: Take, legs: _Pair, arms: _Pair) -> Sequence[list[int]]:
    """The arms in the order of the legs, by where they lie over all frames."""
    across = take.positions[:, legs.chains[0][0]] - take.positions[:, legs.chains[1][0]]
    apart = take.positions[:, arms.chains[0][0]] - take.positions[:, arms.chains[1][0]]
    if np.linalg.norm(apart, axis=-1).mean() < 1e-6 * arms.length:  # both begin at the chest
        apart = take.positions[:, arms.chains[0][1]] - take.positions[:, arms.chains[1][1]]
    return arms.chains if (across * apart).sum() > 0 else arms.chains[::-1]


def _sides(
    take: Take, legs: Sequence[dict[str, int]], pelvis: int, chest: int
) -> tuple[str, str] | None:
    """The side of each leg, by the motion."""
    place = take.positions
    up = place[:, chest] - place[:, pelvis]
    across = place[:, legs[0]["hip"]] - place[:, legs[1]["hip"]]
    forward = np.zeros_like(up)
    for leg in legs:
        if "foot" in leg:
            forward += place[:, leg["foot"]] - place[:, leg["ankle"]]
        else:
            middle = (place[:, leg["hip"]] + place[:, leg["ankle"]]) / 2
            forward += place[:, leg["knee"]] - middle
    first_is_left = (np.cross(up, forward) * across).sum(axis=-1) > 0
    share = first_is_left.mean()
    if max(share, 1 - share) < _SURE:
        return None
    return ("left", "right") if share > 0.5 else ("right", "left")


def _neck(take: Take, arms: _Pair) -> dict[str, int]:
    of_arms = {chain[0] for chain in arms.chains}
    others = [child for child in _children(take, arms.parent) if child not in of_arms]
    if not others:
        return {}
    reach = _reaches(take)
    chain = _chain(take, max(others, key=lambda child: reach[child]))
    return dict(zip(("neck", "head"), chain, strict=False))
