"""How a rest pose's arms are rolled, measured from the axis about which their elbows bend.

Bones tell where a limb points, but not how it is rolled about itself. An elbow is a hinge: in
SMPL's T-pose it bends about the vertical. The axis about which it bends in a captured motion
therefore tells by how much the source's upper arm is rolled against SMPL's. Skeletons of the same
joint names differ in this, so that names do not tell it.
"""

from collections.abc import Mapping

import numpy as np

_MIN_FLEXION_RAD = np.radians(10.0)  # a straighter arm shows no axis
_MIN_AGREEMENT = 0.8  # length of the mean axis; 1 for a perfect hinge
_PARTS = ("shoulder", "elbow")


def measured_twists(arms: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, float]:
    """Twist in degrees of each shoulder and elbow, as `JointMap.twist_deg` has it.

    An arm that never bends, or about no particular axis, is taken to be the mirror image of the
    other. If that holds for both arms, no twist is measured.

    Args:
        arms: "left" and "right" to the global rotations (N, 3, 3) of upper arm and forearm away
            from a T-pose that points as SMPL's does, but may be rolled.

    Returns:
        Twists of `{side}_shoulder` and `{side}_elbow`, or nothing.
    """
    signs = {"left": 1.0, "right": -1.0}
    found = {side: _hinge_twist(*arms[side], signs[side]) for side in arms}
    known = {side: twist for side, twist in found.items() if twist is not None}
    if not known:
        return {}
    mirrored = {side: -next(iter(known.values())) for side in found}
    twists = {side: known.get(side, mirrored[side]) for side in found}
    return {f"{side}_{part}": twist for side, twist in twists.items() for part in _PARTS}


def _hinge_twist(upper: np.ndarray, forearm: np.ndarray, sign: float) -> float | None:
    """Angle in degrees about the arm's direction from the measured hinge to SMPL's."""
    along = np.array([sign, 0.0, 0.0])
    pointing = np.einsum("nba,nbc,c->na", upper, forearm, along)  # as the upper arm sees it
    axes = np.cross(along, pointing)
    sine = np.linalg.norm(axes, axis=1)
    bent = np.arctan2(sine, pointing @ along) > _MIN_FLEXION_RAD
    mean = axes[bent].sum(axis=0)
    if not bent.any() or np.linalg.norm(mean) < _MIN_AGREEMENT * sine[bent].sum():
        return None
    # SMPL's forearms come forward about -Y on the left and +Y on the right.
    turn = np.arctan2(0.0, -sign) - np.arctan2(mean[2], mean[1])
    return float(np.degrees(sign * np.arctan2(np.sin(turn), np.cos(turn))))
