"""Limbs of the body, and which of them cloth lies on."""

import numpy as np
from scipy.spatial import KDTree

from drapeline.frames import JOINT_NAMES

_OVERLAP_M = 0.05  # how far a limb reaches into what it grows from
_AT_HOME_M = 0.08  # cloth that is farther from the body at rest lies on no limb
_HAND = ("wrist", "hand")
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar")
_LIMBS = {
    "trunk": (*_TRUNK, "left_hip", "right_hip"),
    **{
        f"{side}_{limb}": tuple(f"{side}_{joint}" for joint in joints) + trunk
        for side in ("left", "right")
        for limb, joints, trunk in (
            ("arm", ("collar", "shoulder", "elbow", "wrist", "hand"), ()),
            ("leg", ("hip", "knee", "ankle", "foot"), ("pelvis", "spine1")),
        )
    },
}


def split_limbs(vertices: np.ndarray, faces: np.ndarray, segments: np.ndarray) -> list[np.ndarray]:
    """Numbers of the faces of each limb, which overlap, and of all faces.

    Args:
        vertices: (B, 3) metres of the body in frame 0.
        faces: (F, 3).
        segments: (B,) the joint that moves each vertex most.
    """
    parts = []
    centres = vertices[faces].mean(axis=1)
    for limb in _LIMBS.values():
        member = np.isin(segments, [JOINT_NAMES.index(name) for name in limb])
        if not member.any():
            parts.append(np.zeros(0, dtype=np.int64))
            continue
        away, _ = KDTree(vertices[member]).query(centres, distance_upper_bound=_OVERLAP_M)
        parts.append(np.flatnonzero(np.isfinite(away)))
    return [*parts, np.arange(len(faces))]


def hand_numbers(faces: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Number of the hand that each face (F,) belongs to: 1 left, 2 right, 0 for none."""
    number = np.array(
        [
            1 + name.startswith("right") if name.split("_")[-1] in _HAND else 0
            for name in JOINT_NAMES
        ]
    )
    return number[segments[faces]].max(axis=1)


def _limb_of(joint: str) -> int:
    return next(number for number, names in enumerate(_LIMBS.values()) if number and joint in names)


def home_limbs(vertices: np.ndarray, segments: np.ndarray, cloth: np.ndarray) -> np.ndarray:
    """Number (V,) of the limb that each vertex of the cloth lies on, or of the whole body."""
    away, nearest = KDTree(vertices).query(cloth)
    home = np.array([0 if name in _TRUNK else _limb_of(name) for name in JOINT_NAMES])
    return np.where(away < _AT_HOME_M, home[segments[nearest]], len(_LIMBS))
