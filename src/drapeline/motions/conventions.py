"""Conventions of motion files, measured from the moving frames: axes, sides, rest pose, unit.

Nothing that a file leaves unsaid is assumed where the motion contradicts it: what explains the
motion is taken and said in the log, and what nothing explains is refused.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.motions.joint_map import AXES, UNITS_M, JointMap
from drapeline.motions.rest_pose import stand_up, stands
from drapeline.motions.retarget import body_frame, leg_length
from drapeline.motions.skeleton import Take, reference_joints, rotation_between
from drapeline.rule_log import LOGGER

_TRUNK_COS = np.cos(np.radians(40.0))  # of an upright person, from the vertical
_LEG_COS = np.cos(np.radians(35.0))
_MOST, _FEW = 0.8, 0.2  # shares of the frames
_LEG_LENGTHS_M = (0.2, 1.6)  # hip to knee to ankle, from small children to giants
_BY_NAME = {name: index for index, name in enumerate(JOINT_NAMES)}
_SIDES = ("left", "right")
_MAX_ANGLE_RAD = 3 * np.pi  # of a joint; half a turn is the most that means anything
_MAX_HEIGHT_M = 20.0  # of the lowest joint from the origin
_MAX_SLIP_M_S = 0.5


def explain_take(take: Take, joint_map: JointMap) -> tuple[Take, JointMap]:
    """The take on a standing rest pose, and the map with the vertical axis if it is another.

    A take whose rest pose stands, and which moves upright along it, is returned as it is.

    Raises:
        InputError: no vertical axis explains the motion, left and right are exchanged, or the
            legs have no length of a person's in the unit that the map gives.
    """
    source = joint_map.indices(take)
    if joint_map.unit is not None:
        _check_legs(take, source, joint_map)
    _check_sides(take.positions, source, take.source)
    shares = upright_shares(take.positions, source)
    best = max(shares, key=lambda axis: shares[axis])
    if not stands(take.rest_positions(), source):
        leg_length(take.rest_positions(), source, take.source)
        take = stand_up(take, source)
        usual = "Y"
        if joint_map.up is None and shares[best] < 0.5:
            raise InputError(
                f"{take.source}: its rest pose is no standing person and the motion is upright "
                f"along no axis ({_listed(shares)}), expected an 'up' in a joint map"
            )
        LOGGER.info("%s: its rest pose is no standing person; axes of joints measured", take.source)
    else:
        frame = body_frame(take.rest_positions(), source, take.source)
        usual = max(AXES, key=lambda axis: float(frame[1] @ AXES[axis]))
    up = joint_map.up or _measured_up(shares, usual, take.source)
    return take, joint_map if up == usual else replace(joint_map, up=up)


def explain_poses(
    poses: np.ndarray, trans: np.ndarray, fps: float, given: JointMap | None, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """SMPL poses (N, 72) and root path (N, 3) turned to a Z-up world in metres.

    Args:
        poses: radians in the file's world, Z up if the motion does not contradict it.
        trans: root joint in metres, as far as anybody knows.
        given: a map whose `up` is obeyed and whose `unit` means that the path is in metres by now;
            its joints are not needed.
        name: the file; named in errors.

    Raises:
        InputError: the angles are no radians, or the path is not in metres and no unit is given.
    """
    _check_radians(poses, name)
    places, _ = reference_joints(poses, trans)
    up = (
        given.up
        if given and given.up
        else _measured_up(upright_shares(places, _BY_NAME), "Z", name)
    )
    if up != "Z":
        turn = rotation_between(AXES[up], AXES["Z"])
        poses, trans = poses.copy(), trans @ turn.T
        poses[:, :3] = (Rotation.from_matrix(turn) * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    if given is None or given.unit is None:
        _check_metres(poses, trans, fps, name)
    return poses, trans


def _check_radians(poses: np.ndarray, name: str) -> None:
    angles = np.linalg.norm(poses.reshape(len(poses), -1, 3), axis=2)
    if angles.size and angles.max() > _MAX_ANGLE_RAD:
        frame, joint = np.unravel_index(angles.argmax(), angles.shape)
        raise InputError(
            f"{name}: frame {frame}, joint {JOINT_NAMES[joint]} turns by {angles.max():.3g},"
            " expected radians (are the poses in degrees?)"
        )


def _check_metres(poses: np.ndarray, trans: np.ndarray, fps: float, name: str) -> None:
    """Feet on the ground tell the unit of the path: with the right one they hardly move."""
    advice = "expected metres, or their 'unit' in a joint map"
    height = float(np.median(reference_joints(poses, trans)[0][:, :, 2].min(1)))
    if abs(height) > _MAX_HEIGHT_M:
        raise InputError(f"{name}: its lowest joint is at {height:.0f} m, {advice}")
    slips = {unit: _foot_speed(poses, trans * metres, fps) for unit, metres in UNITS_M.items()}
    likely = min(slips, key=lambda unit: slips[unit])
    if slips["m"] > _MAX_SLIP_M_S and slips[likely] < 0.2 * slips["m"]:
        raise InputError(
            f"{name}: the slower foot moves at {slips['m']:.1f} m/s in most frames, and at "
            f"{slips[likely]:.1f} m/s if the path is in {likely}; {advice}"
        )


def _foot_speed(poses: np.ndarray, trans: np.ndarray, fps: float) -> float:
    """Median over the frames of the speed of the slower ankle in m/s."""
    if len(poses) < 2:
        return 0.0
    ankles = reference_joints(poses, trans)[0][:, [_BY_NAME[f"{side}_ankle"] for side in _SIDES]]
    speeds = np.linalg.norm(np.diff(ankles, axis=0), axis=-1) * fps
    return float(np.median(speeds.min(1)))


def upright_shares(positions: np.ndarray, source: dict[str, int]) -> dict[str, float]:
    """Share of frames in which trunk and legs stand along each axis of the file's world.

    Args:
        positions: (N, J, 3) joints in any unit.
        source: joint index for each mapped SMPL joint.
    """
    hips, shoulders, ankles = (
        positions[:, [source[f"{side}_{part}"] for side in _SIDES]].mean(1)
        for part in ("hip", "shoulder", "ankle")
    )
    trunk, legs = _directions(shoulders - hips), _directions(hips - ankles)
    return {
        name: float(((trunk @ axis > _TRUNK_COS) & (legs @ axis > _LEG_COS)).mean())
        for name, axis in AXES.items()
    }


def _measured_up(shares: dict[str, float], usual: str, name: str) -> str:
    """The usual axis, unless hardly a frame is upright along it and most are along another."""
    best = max(shares, key=lambda axis: shares[axis])
    if shares[usual] < _FEW and shares[best] > _MOST:
        LOGGER.warning(
            "%s: %s is taken to be up instead of %s, as %.0f %% of the frames are upright along it;"
            " 'up' in a joint map says otherwise",
            *(name, best, usual, 100 * shares[best]),
        )
        return best
    return usual


def _check_sides(positions: np.ndarray, source: dict[str, int], name: str) -> None:
    """Feet point to the front of hips and trunk, unless left and right are exchanged."""
    if not {"left_foot", "right_foot"} <= source.keys():
        return
    place = {joint: positions[:, index] for joint, index in source.items()}
    up = place["left_shoulder"] + place["right_shoulder"] - place["left_hip"] - place["right_hip"]
    front = _directions(np.cross(place["left_hip"] - place["right_hip"], up))
    ahead = sum(
        np.einsum("na,na->n", _directions(place[f"{side}_foot"] - place[f"{side}_ankle"]), front)
        for side in _SIDES
    )
    share = float((ahead < 0).mean())
    if share > _MOST:
        raise InputError(
            f"{name}: the feet point backwards in {100 * share:.0f} % of the frames, expected left"
            " and right as the person has them (a mirrored file, or sides exchanged in the map?)"
        )


def _check_legs(take: Take, source: dict[str, int], joint_map: JointMap) -> None:
    length = leg_length(take.rest_positions(), source, take.source) * UNITS_M[joint_map.unit or "m"]
    if not _LEG_LENGTHS_M[0] <= length <= _LEG_LENGTHS_M[1]:
        raise InputError(
            f"{take.source}: legs of {length:.3g} m by the unit '{joint_map.unit}' of "
            f"{joint_map.name}, expected those of a person"
        )


def _listed(shares: dict[str, float]) -> str:
    return ", ".join(f"{axis} in {100 * share:.0f} %" for axis, share in shares.items())


def _directions(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
