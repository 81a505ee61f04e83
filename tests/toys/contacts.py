"""One contact of a few vertices of cloth, as the kernels of the fast solver see it."""

import numpy as np
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.cloth_contact import approach_triangles, part_triangles, touch_cloth
from drapeline.xpbd.contact import make_all_moves, make_meetings, make_moves, make_near
from drapeline.xpbd.edge_contact import approach_edges, part_edges, touch_edges

OWN_GAP, LAYER_GAP = 0.007, 0.004
RELEASE_M = 3e-4
STEP_S = 1 / 1200
MASS = np.array([1.0, 2, 3, 4])
FAR = (1e3, 1e3)
# The layer of one of two sheets, the room, and how far apart they are kept.
GAPS = [
    (0, FAR, OWN_GAP),
    (1, FAR, LAYER_GAP),
    # Where the body faces itself sheets have a third of the room, at either end of the frame.
    (0, (0.009, 0.03), 0.003),
    (1, (0.03, 0.006), 0.002),
    (1, (0.03, 0.03), LAYER_GAP),
]


def after_contact(parts, old, new, *, layers, clearance=FAR, friction=None, apart=False):
    """Places (4, 3) after a contact, and those that count as before it.

    A contact alone does the same whether contacts act in turn or at once.

    Args:
        parts: a triangle (1, 3) that the last vertex is near to, or two edges (2, 2).
        old, new: (4, 3) places before the step and now, of vertices that weigh `MASS`.
        layers: (4,) of the vertices.
        clearance: where the body faces itself.
        friction: of a vertex on a triangle.
        apart: whether they are only kept from passing through, instead of pushed to the gap.
    """
    start_warp()
    args = (parts, old, new, layers, clearance, friction, apart)
    in_turn, at_once = (_after_contact(*args, parallel=parallel) for parallel in (False, True))
    np.testing.assert_allclose(at_once, in_turn, atol=1e-7)
    return in_turn


def _after_contact(parts, old, new, layers, clearance, friction, apart, *, parallel):
    old, new = (wp.array(np.float32(part), dtype=wp.vec3) for part in (old, new))
    triangle = len(parts[0]) == 3
    shapes = wp.array(np.int32(parts), dtype=wp.types.vector(len(parts[0]), int))
    busy, count = wp.array([3 if triangle else 0], dtype=int), 4 if triangle else 2
    near, meetings = make_near(count, 1), make_meetings(count, 1)
    near.count.numpy()[busy.numpy()] = 1
    near.other.fill_(0 if triangle else 1)
    near.room_m.fill_(1e3)
    moves = make_moves(4 if parallel else 0)
    approach, touch, part = (
        (approach_triangles, touch_cloth, part_triangles)
        if triangle
        else (approach_edges, touch_edges, part_edges)
    )
    wp.launch(
        approach,
        dim=1,
        inputs=[
            *(busy, near, shapes, wp.array(np.int32(layers), dtype=int)),
            wp.array(np.float32([clearance] * 4), dtype=wp.vec2),
            *(wp.array([0.0, 0.025], dtype=float), 40, STEP_S, OWN_GAP, LAYER_GAP),
            wp.array((new.numpy() - old.numpy()) / STEP_S, dtype=wp.vec3),
        ],
        outputs=[old, meetings],
    )
    state = [moves, old, new]
    if apart:
        wp.launch(part, dim=1, inputs=[busy, meetings, shapes, *state, wp.zeros(1, dtype=int)])
    else:
        mass = wp.array(np.float32(1 / MASS), dtype=float)
        numbers = [RELEASE_M]
        if friction is not None:
            numbers.append(wp.full(4, friction, dtype=float))
        wp.launch(touch, dim=1, inputs=[busy, meetings, shapes, mass, *numbers, *state])
    wp.launch(make_all_moves, dim=len(moves.weight), inputs=[moves], outputs=[old, new])
    return new.numpy().astype(float), old.numpy().astype(float)
