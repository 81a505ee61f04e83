import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.contact import held_slip, narrowed


@wp.kernel
def _hold(slip: wp.vec3, up: wp.vec3, most: float, held: wp.array(dtype=wp.vec3)):
    held[wp.tid()] = held_slip(slip, up, most)


@pytest.mark.parametrize(
    ("most", "held"), [(9.0, [3, 4, 0]), (5.0, [3, 4, 0]), (1.0, [0.6, 0.8, 0]), (0.0, [0, 0, 0])]
)
def test_friction_holds_what_is_along_the_surface_up_to_its_limit(most, held):
    start_warp()
    found = wp.zeros(1, dtype=wp.vec3)
    up, slip = wp.vec3(0.0, 0.0, 1.0), wp.vec3(3.0, 4.0, 7.0)
    wp.launch(_hold, dim=1, inputs=[slip, up, most], outputs=[found])
    np.testing.assert_allclose(found.numpy()[0], held, atol=1e-6)


@wp.kernel
def _narrow(gap: float, rooms: wp.array(dtype=wp.vec2), gaps: wp.array(dtype=float)):
    gaps[wp.tid()] = narrowed(gap, rooms[wp.tid()])


def test_sheets_are_closer_to_each_other_where_the_body_faces_itself():
    start_warp()
    rooms = wp.array(
        np.float32([[1e3, 1e3], [0.012, 0.03], [0.006, 0.003], [0.0, 0.01]]),
        dtype=wp.vec2,
    )  # fmt: skip
    gaps = wp.zeros(4, dtype=float)
    wp.launch(_narrow, dim=4, inputs=[0.005, rooms], outputs=[gaps])
    np.testing.assert_allclose(gaps.numpy(), [0.005, 0.004, 0.001, 0.0], atol=1e-7)
