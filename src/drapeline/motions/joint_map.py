"""Joint maps: which joint of a source skeleton drives each SMPL joint (YAML)."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drapeline.errors import InputError, refuse_damage
from drapeline.frames import JOINT_NAMES
from drapeline.motions.joint_names import name_joints
from drapeline.motions.joint_structure import find_joints
from drapeline.motions.skeleton import Take
from drapeline.rule_log import LOGGER
from drapeline.storage import read_text

BUILT_IN = Path(__file__).parent / "joint_maps"
_LIMB_PARTS = ("hip", "knee", "ankle", "shoulder", "elbow")
REQUIRED = ("pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in _LIMB_PARTS))
_TWISTABLE = ("hip", "knee", "shoulder", "elbow")
KEYS = ("joints", "up", "unit", "twist_deg")
AXES = {
    f"{sign}{name}": factor * np.eye(3)[axis]
    for sign, factor in (("", 1.0), ("-", -1.0))
    for axis, name in enumerate("XYZ")
}
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}


@dataclass(frozen=True)
class JointMap:
    """A source skeleton's joints by SMPL joint name.

    Attributes:
        name: file or built-in map it came from; named in errors.
        joints: SMPL joint name to source joint name; unlisted joints follow their neighbours.
            None at all leave the joints to the built-in maps.
        up: the file's vertical axis, one of X Y Z -X -Y -Z; None takes the one along which the
            person stands.
        unit: the file's unit of length; None takes that of a person's legs.
        twist_deg: SMPL limb joint to the angle about the limb's direction that its rest pose lacks
            to be SMPL's. Bone directions cannot tell it. That of shoulders and elbows is measured
            from the motion where it is not given.
    """

    name: str
    joints: dict[str, str]
    up: str | None = None
    unit: str | None = None
    twist_deg: dict[str, float] = field(default_factory=dict)

    def indices(self, take: Take) -> dict[str, int]:
        """Joint index in the take for each mapped SMPL joint.

        Raises:
            InputError: names the joints that the take lacks.
        """
        missing = sorted(set(self.joints.values()) - set(take.names))
        if missing:
            raise InputError(
                f"{take.source}: has no joint {_join(missing)} that joint map {self.name} names; "
                f"it has {_join(take.names)}"
            )
        return {joint: take.names.index(source) for joint, source in self.joints.items()}


_MOST_BYTES = 1_000_000


class _PlainLoader(yaml.SafeLoader):
    """Refuses aliases: a few of them make a value that takes for ever to print."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError("it has an alias (*), expected plain values")
        return super().compose_node(parent, index)


def load_joint_map(path: str | Path) -> JointMap:
    """Read a joint map from YAML.

    Raises:
        InputError: the file is missing, is not YAML, or maps a joint that SMPL does not have.
    """
    path = Path(path)
    text = read_text(path, "a joint map in YAML", most_bytes=_MOST_BYTES)
    with refuse_damage(path, "YAML, expected a joint map"):
        content = yaml.load(text, _PlainLoader)
    if not isinstance(content, dict) or not isinstance(content.get("joints", {}), dict):
        raise InputError(f"{path}: expected a key 'joints' with SMPL joint: source joint lines")
    strange = sorted(set(map(str, content)) - set(KEYS))
    if strange:
        raise InputError(f"{path}: unknown key {_join(strange)}, expected of {_join(KEYS)}")
    if not content:
        raise InputError(f"{path}: is empty, expected one or more of {_join(KEYS)}")
    joints = {str(key): str(value) for key, value in content.get("joints", {}).items()}
    unknown = sorted(set(joints) - set(JOINT_NAMES))
    if unknown:
        raise InputError(
            f"{path}: {_join(unknown)} is no SMPL joint, which are {_join(JOINT_NAMES)}"
        )
    lacking = [joint for joint in REQUIRED if joint not in joints]
    if lacking and "joints" in content:
        raise InputError(f"{path}: maps no source joint to {_join(lacking)}, which is required")
    chosen = {}
    for key, known in (("up", AXES), ("unit", UNITS_M)):
        chosen[key] = content.get(key)
        if chosen[key] is not None and str(chosen[key]) not in known:
            raise InputError(f"{path}: '{key}' is {chosen[key]!r}, expected one of {_join(known)}")
    return JointMap(
        str(path), joints, **chosen, twist_deg=_twists(path, content.get("twist_deg", {}))
    )


def _twists(path: Path, content: object) -> dict[str, float]:
    limbs = [joint for joint in REQUIRED if joint.split("_")[-1] in _TWISTABLE]
    if not isinstance(content, dict) or not set(content) <= set(limbs):
        raise InputError(f"{path}: 'twist_deg' is {content}, expected angles of {_join(limbs)}")
    for joint, angle in content.items():
        if not isinstance(angle, int | float) or not -180 <= angle <= 180:
            raise InputError(f"{path}: twist of {joint} is {angle}, expected -180 to 180 degrees")
    return {joint: float(angle) for joint, angle in content.items()}


def built_in_map(take: Take) -> JointMap:
    """The shipped map whose joints the take has; the one that drives most joints if several fit.

    A prefix that all of a file's joints share, such as ``mixamorig:``, is ignored. Where no map
    fits, joints are found by the words of their names (`name_joints`) or by the skeleton's shape
    (`find_joints`), which is said in the log.

    Raises:
        InputError: no shipped map fits; names the joints and what to write.
    """
    prefix = take.names[0][: take.names[0].rfind(":") + 1]
    shipped = [load_joint_map(path) for path in sorted(BUILT_IN.glob("*.yaml"))]
    if not all(name.startswith(prefix) for name in take.names):
        prefix = ""
    fitting = []
    for joint_map in shipped:
        joints = {joint: prefix + source for joint, source in joint_map.joints.items()}
        if set(joints.values()) <= set(take.names):
            fitting.append(replace(joint_map, joints=joints))
    if fitting:
        return max(fitting, key=lambda joint_map: len(joint_map.joints))
    joints = name_joints(take)
    if joints:
        listed = ", ".join(f"{joint}: {source}" for joint, source in joints.items())
        LOGGER.info("%s: joints found by their names: %s", take.source, listed)
        return JointMap("found by names", joints)
    joints = find_joints(take)
    if joints:
        listed = ", ".join(f"{joint}: {source}" for joint, source in joints.items())
        LOGGER.warning("%s: joints found by the skeleton's shape: %s", take.source, listed)
        return JointMap("found by shape", joints)
    raise InputError(
        f"{take.source}: joints {_join(take.names)} fit no built-in map "
        f"({_join(Path(joint_map.name).stem for joint_map in shipped)}), expected a "
        "'joint_map' YAML file that names the source joint of each SMPL joint"
    )


def _join(names: Iterable[object]) -> str:
    texts = [str(name) for name in names]
    shown = ", ".join(texts[:40])
    return shown if len(texts) <= 40 else f"{shown} and {len(texts) - 40} more"
