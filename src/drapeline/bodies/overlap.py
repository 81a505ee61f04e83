"""How much of a body in motion lies inside the body itself."""

from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.self_collision import part_of_joint
from drapeline.geometry.mesh import faces_within
from drapeline.geometry.self_overlap import SelfOverlap

_EVERY = 3  # frames between those that are measured


class Overlap(NamedTuple):
    """What is left of self-collisions in a body's surface, over every third frame.

    A vertex is inside if the winding number of the surface is above 0 a tenth of a millimetre
    outside its own place. What the mean body has inside at rest, as in its mouth, does not count.
    """

    share: float  # mean share of the vertices that are inside
    # The greatest distance of one from the surface of another part of the body, metres, see
    # `SelfOverlap`.
    depth_m: float


def measure_overlap(body: BodyModel, vertices: np.ndarray, collides: np.ndarray) -> Overlap:
    """Measure how a body overlaps itself.

    Args:
        vertices: (N, V, 3) metres, anywhere.
        collides: (V,) mask of the vertices that count; the surface ends where theirs does.
    """
    parts = part_of_joint()[body.segmentation]
    find_inside = SelfOverlap(body.faces, parts)
    folded = np.zeros(len(parts), dtype=bool)
    folded[find_inside(body.v_template)[0]] = True
    if not collides.all():
        find_inside = SelfOverlap(faces_within(body.faces, collides), parts)
    count, depth_m = 0, 0.0
    measured = vertices[::_EVERY]
    for frame in measured:
        inside, depths = find_inside(frame)
        counted = ~folded[inside]
        count += int(counted.sum())
        depth_m = max(depth_m, float(depths[counted].max(initial=0)))
    total = len(measured) * int((collides & ~folded).sum())
    return Overlap(count / max(total, 1), depth_m)
