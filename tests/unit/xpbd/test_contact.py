import numpy as np
import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.contact import held_slip


@wp.kernel
def _hold(slip: wp.vec3, up: wp.vec3, most: float, held: wp.array(dtype=wp.vec3)):
    held[wp.tid()] = held_slip(slip, up, most)


@pytest.mark.parametrize(
    ("most", "held"), [(9.0, [3, 4, 0]), (5.0, [3, 4, 0]), (1.0, [0.6, 0.8, 0]), (0.0, [0, 0, 0])]
)
def test_friction_holds_what_is_along_the_surface_up_to_its_limit(most, held):
    start_warp()
    found = wp.zeros(1, dtype=wp.vec3, device="cpu")
    up, slip = wp.vec3(0.0, 0.0, 1.0), wp.vec3(3.0, 4.0, 7.0)
    wp.launch(_hold, dim=1, inputs=[slip, up, most], outputs=[found], device="cpu")
    np.testing.assert_allclose(found.numpy()[0], held, atol=1e-6)
