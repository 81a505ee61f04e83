"""Directions of a skeleton's limbs."""

import numpy as np

from drapeline.frames import JOINT_NAMES

INDEX = {name: index for index, name in enumerate(JOINT_NAMES)}
LIMBS = [
    (f"{side}_{start}", f"{side}_{end}")
    for side in ("left", "right")
    for start, end in (
        ("hip", "knee"),
        ("knee", "ankle"),
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
    )
]


def directions(joints: np.ndarray) -> np.ndarray:
    """(N, limbs, 3) unit vectors along the limbs of joints (N, 24, 3)."""
    bones = np.stack([joints[:, INDEX[b]] - joints[:, INDEX[a]] for a, b in LIMBS], axis=1)
    return bones / np.linalg.norm(bones, axis=-1, keepdims=True)
