"""The ray tracer: what hides and shades what, and light on balls where it is known."""

import numpy as np
import pytest
import trimesh

from drapeline.rendering.camera import look_at
from drapeline.rendering.raytracer import ColouredMesh, ray_share, raytrace

BOX = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.5, 1.1)])
SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
BACKDROP = round(255 * 0.93)


@pytest.fixture
def camera():
    target = np.array([0.0, 0.0, 0.8])
    return look_at(target + [0.0, -5.0, 1.0], target, focal_px=200, size=(96, 128))


def test_empty_backdrop_is_even_and_things_stand_where_the_camera_sees_them(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    assert (picture[:10] == BACKDROP).all()
    blue = picture[..., 2].astype(int) - picture[..., 0] > 40
    where, _ = camera.project(BOX)
    rows, columns = np.nonzero(blue)
    assert columns.min() == pytest.approx(where[:, 0].min(), abs=1.5)
    assert columns.max() + 1 == pytest.approx(where[:, 0].max(), abs=1.5)
    assert rows.min() == pytest.approx(where[:, 1].min(), abs=1.5)


def test_shadow_lies_on_the_floor_and_away_from_the_lamp(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    grey = np.ptp(picture.astype(int), axis=2) <= 2
    rows, columns = np.nonzero(grey & (picture[..., 0] < BACKDROP - 15))
    (_, horizon), _ = camera.project(np.array([0.0, 1e6, 0.0]))
    assert rows.min() > horizon
    assert columns.mean() > 48  # the lamp stands to the left of the camera


def test_the_nearer_thing_hides_the_other(camera):
    near = ColouredMesh(BOX + [0, -1, 0], SIDES, (0.9, 0.1, 0.1))
    far = ColouredMesh(BOX + [0, 1, 0], SIDES, (0.1, 0.1, 0.9))
    for parts in ([near, far], [far, near]):
        middle = raytrace(parts, camera, samples=4)[60:66, 44:52].reshape(-1, 3).mean(0)
        assert middle[0] > middle[2] + 60


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
