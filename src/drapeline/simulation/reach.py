"""Which parts of a body cloth can touch: the others need not be collided with."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.frames import JOINT_NAMES

# Far from most garments, and more than half of a body's faces.
_PARTS = (
    ("head",),
    *(
        tuple(f"{side}_{joint}" for joint in joints)
        for side in ("left", "right")
        for joints in (("wrist", "hand"), ("ankle", "foot"))
    ),
)
_SPARE_M = 0.1  # how much farther cloth may swing than it stands off at first
_EVERY = 5


def parts_within_reach(
    body: BodyModel, frames: Iterable[np.ndarray], garments: Iterable[np.ndarray]
) -> np.ndarray:
    """Mask (V,) of body vertices that collide: all but heads, hands, feet that no cloth reaches.

    Args:
        frames: body vertices (V, 3) over time, the first in the garments' pose.
        garments: rest vertices (G, 3) in the frame of the first.
    """
    part_of = np.full(24, -1)
    for number, names in enumerate(_PARTS):
        part_of[[JOINT_NAMES.index(name) for name in names]] = number
    part = part_of[body.segmentation]
    found = np.zeros(len(_PARTS), dtype=bool)
    covered = np.zeros(0, dtype=np.int64)
    reach = 0.0
    for index, vertices in enumerate(frames):
        if index == 0:
            cloth = np.concatenate(list(garments))
            distance, nearest = KDTree(vertices).query(cloth)
            covered = np.unique(nearest)[::2]
            reach = float(distance.max()) + _SPARE_M
        if index % _EVERY:
            continue
        tree = KDTree(vertices[covered])
        for number in np.flatnonzero(~found):
            member = np.flatnonzero(part == number)[::4]
            # Vertices that cloth lies on belong to what is covered, at distance zero.
            away, _ = tree.query(vertices[member], distance_upper_bound=reach)
            found[number] = np.isfinite(away).any()
    return (part < 0) | found[part]
