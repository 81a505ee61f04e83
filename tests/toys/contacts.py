"""One contact of a few vertices of cloth, as the kernels of the fast solver see it."""

import numpy as np
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.contact import make_all_moves, make_moves
from drapeline.xpbd.stepping import BusyLaunch

OWN_GAP, LAYER_GAP = 0.007, 0.004
RELEASE_M = 3e-4
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


def after_contact(kernel, near, parts, old, new, *, layers, clearance=FAR, friction=()):
    """Places (4, 3) after a contact, and those that count as before it.

    A contact alone does the same whether contacts act in turn or at once.

    Args:
        kernel: `touch_cloth` or `touch_edges`.
        near: what each vertex or edge is near to, by the kernel's numbers; 0 for nothing.
        parts: triangles (F, 3) or edges (E, 2).
        old, new: (4, 3) places before the step and now, of vertices that weigh `MASS`.
        layers: (4,) of the vertices.
        clearance: where the body faces itself.
        friction: of the kernel, if it has one.
    """
    start_warp()
    args = (kernel, near, parts, old, new, layers, clearance, friction)
    in_turn, at_once = (_after_contact(*args, parallel=parallel) for parallel in (False, True))
    np.testing.assert_allclose(at_once, in_turn, atol=1e-7)
    return in_turn


def _after_contact(kernel, near, parts, old, new, layers, clearance, friction, *, parallel):
    near = np.array(near, np.int32)
    state = [wp.array(np.float32(part), dtype=wp.vec3) for part in (old, new)]
    launch = BusyLaunch(
        kernel,
        wp.array((near != 0).astype(np.int32), dtype=int),
        inputs=[
            wp.array(near[:, None], dtype=int),
            wp.array(np.int32(parts), dtype=wp.types.vector(len(parts[0]), int)),
            wp.array(np.int32(layers), dtype=int),
            wp.array(np.float32(1 / MASS), dtype=float),
            wp.array(np.float32([clearance] * 4), dtype=wp.vec2),
            *(OWN_GAP, LAYER_GAP, RELEASE_M, *friction),
        ],
        outputs=[moves := make_moves(4 if parallel else 0), *state],
    )
    launch.find()
    launch.launch()
    wp.launch(make_all_moves, dim=len(moves.weight), inputs=[moves], outputs=state)
    before, place = (part.numpy().astype(float) for part in state)
    return place, before
