"""Rest poses of takes, measured from the moving frames.

Some programs write skeletons whose zero pose is no standing person: all bones lie along one axis,
or along one axis on the left and against it on the right. What a joint's own axes mean is then told
by its bones, which never move in them, and by how the person moves.
"""

from dataclasses import replace

import numpy as np

from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.motions.skeleton import REFERENCE_OFFSETS, Take, chain, rotation_between, unit

_ALONG_AXIS_COS = np.cos(np.radians(1.0))
_NEAR_AXIS_COS = np.cos(np.radians(30.0))
_LEG_COS = np.cos(np.radians(55.0))  # of a leg in a rest pose, from the downward direction
_SPINE = ("spine1", "spine2", "spine3", "neck", "head")
_INDEX = {name: index for index, name in enumerate(JOINT_NAMES)}
_REFERENCE = chain(PARENTS, np.eye(3)[None, None], REFERENCE_OFFSETS[None])[0]


def stands(rest: np.ndarray, source: dict[str, int]) -> bool:
    """Whether a pose (J, 3) is a standing person's: legs opposite the trunk, sides alike.

    Args:
        rest: joint positions.
        source: joint index for each mapped SMPL joint.
    """
    hips, shoulders, ankles = (
        rest[[source[f"{side}_{part}"] for side in ("left", "right")]]
        for part in ("hip", "shoulder", "ankle")
    )
    up = unit(shoulders.mean(0) - hips.mean(0))
    legs = ankles - hips
    down = -(legs @ up) > _LEG_COS * np.linalg.norm(legs, axis=1)
    return bool(down.all() and (hips[0] - hips[1]) @ (shoulders[0] - shoulders[1]) > 0)


def stand_up(take: Take, source: dict[str, int]) -> Take:
    """The same motion on the same bones, with a T-pose in SMPL's axes as its rest pose.

    Each joint's axes are turned by a constant. Where two or more bones fix it, they are laid as in
    the reference skeleton; where one does, the rest of the turn makes the joint's mean roll zero;
    a joint without mapped bones turns about its mean. The spine is laid either as the reference
    skeleton's or straight: whichever it moves about.
    """
    found = [_calibrate(take, source, straight=straight) for straight in (False, True)]
    turns, _ = min(found, key=lambda result: result[1])
    offsets = take.offsets.copy()
    for joint, parent in enumerate(take.parents):
        if parent >= 0:
            offsets[joint] = turns[parent].T @ take.offsets[joint]
    return replace(take, offsets=offsets, rotations=take.rotations @ turns)


def _calibrate(take: Take, source: dict[str, int], *, straight: bool) -> tuple[np.ndarray, float]:
    """Turns (J, 3, 3) from SMPL's axes to each joint's own, and by how much the spine bends.

    That is the sum of its joints' mean turns in radians.
    """
    names = {index: name for name, index in source.items()}
    turns = np.zeros((len(take.names), 3, 3))
    turned = np.zeros_like(take.rotations)
    bend = 0.0
    for joint, parent in enumerate(take.parents):
        relative = take.rotations[:, joint]
        if parent >= 0:
            relative = np.swapaxes(turned[:, parent], -1, -2) @ relative
        mean = relative.sum(0)
        turn = None
        if joint in names:
            ends = _ends(take, source, joint)
            turn = _turn_by_bones(names[joint], ends, mean, straight=straight)
        if turn is None:
            turn = _nearest_rotation(mean).T
        turns[joint] = turn
        turned[:, joint] = take.rotations[:, joint] @ turn
        if names.get(joint) in _SPINE:
            bend += _angle(_nearest_rotation(mean @ turn))
    return turns, bend


def _ends(take: Take, source: dict[str, int], joint: int) -> dict[str, np.ndarray]:
    """Mapped joints at the ends of a joint's bones: places (3,) in its own axes, on average."""
    ends = {}
    for name, index in source.items():
        above = take.parents[index]
        while above not in (-1, joint) and above not in source.values():
            above = take.parents[above]
        if above == joint:
            step = take.positions[:, index] - take.positions[:, joint]
            ends[name] = np.einsum("nab,na->b", take.rotations[:, joint], step) / len(step)
    return ends


def _turn_by_bones(
    name: str, ends: dict[str, np.ndarray], mean: np.ndarray, *, straight: bool
) -> np.ndarray | None:
    """Turn (3, 3) from SMPL's axes to a mapped joint's own, or None where no bone tells it."""
    start = _REFERENCE[_INDEX[name]]
    middle = [end for end in ends if "_" not in end]
    pairs = [end for end in ends if end.startswith("left_") and f"right_{end[5:]}" in ends]
    along = np.array([0.0, 1.0, 0.0])
    if middle and not straight:
        along = _REFERENCE[_INDEX[middle[0]]] - start
    if pairs and middle:
        left = unit(ends[pairs[0]] - ends[f"right_{pairs[0][5:]}"])
        up = ends[middle[0]]
        if np.abs(left).max() > _ALONG_AXIS_COS:  # axes that somebody laid along the person's
            nearest = np.eye(3)[np.abs(up - left * (left @ up)).argmax()]
            nearest = nearest * np.sign(nearest @ up)
            if nearest @ unit(up) > _NEAR_AXIS_COS:
                up, along = nearest, np.array([0.0, 1.0, 0.0])
        return _frame(left, up) @ _frame(np.array([1.0, 0.0, 0.0]), along).T
    if not ends:
        return None
    end = middle[0] if middle else next(iter(ends))
    if not middle:
        along = _REFERENCE[_INDEX[end]] - start
    if np.linalg.norm(ends[end]) < 1e-9:
        return None
    return _without_roll(rotation_between(along, ends[end]), unit(along), mean)


def _without_roll(turn: np.ndarray, along: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The turn, rolled about a bone's direction (3,) so that the mean roll of its joint is zero."""
    total = mean @ turn
    cross = np.array([[0, -along[2], along[1]], [along[2], 0, -along[0]], [-along[1], along[0], 0]])
    sine, cosine = np.trace(total @ cross), np.trace(total) - along @ total @ along
    angle = np.arctan2(sine, cosine)
    roll = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn @ roll


def _frame(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Axes (3, 3) as columns: left, up across it, front."""
    up = unit(up - left * (left @ up))
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right


def _angle(rotation: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1.0, 1.0)))
