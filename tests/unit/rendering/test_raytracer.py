"""The ray tracer, on balls whose light is known."""

import numpy as np
import trimesh

from drapeline.rendering.camera import look_at
from drapeline.rendering.raytracer import ColouredMesh, ray_share, raytrace


def ball_picture(subdivisions, samples=64):
    """A grey ball that floats above the floor."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.5)
    centre = np.array([0.0, 0.0, 3.0])
    camera = look_at(centre + [0, -4, 0], centre, focal_px=500, size=(150, 150))
    part = ColouredMesh(mesh.vertices + centre, mesh.faces, (0.5, 0.5, 0.5))
    return raytrace([part], camera, samples=samples).astype(int)


def test_a_coarse_ball_is_shaded_like_a_fine_one():
    """Facets that shade one another would leave dark triangles where light grazes."""
    coarse, fine = ball_picture(1), ball_picture(5)
    rows, columns = np.mgrid[:150, :150] - 75
    within = np.hypot(rows, columns) < 55  # of a radius of 62
    away = np.abs(coarse - fine).max(axis=2)[within]
    assert away.max() <= 6
    assert fine[within].max() - fine[within].min() > 50  # light on one side, shade on the other


def test_the_same_input_gives_the_same_picture():
    np.testing.assert_array_equal(ball_picture(2), ball_picture(2))


def test_a_share_of_the_rays_is_as_if_fewer_were_asked_for():
    with ray_share(0.25):
        quick = ball_picture(2)
    with ray_share(0.001):  # one at least
        least = ball_picture(2)
    np.testing.assert_array_equal(quick, ball_picture(2, samples=16))
    np.testing.assert_array_equal(least, ball_picture(2, samples=1))
    assert (quick != ball_picture(2)).any()
