"""The ray tracer: what hides and shades what, and light on balls where it is known."""

import numpy as np
import pytest
import trimesh

from drapeline.rendering.camera import look_at
from drapeline.rendering.raytracer import FLOOR_REACH_M, ColouredMesh, Texture, ray_share, raytrace

BOX = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.5, 1.1)])
SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
WHITE = 255


@pytest.fixture
def camera():
    target = np.array([0.0, 0.0, 0.8])
    return look_at(target + [0.0, -5.0, 1.0], target, focal_px=200, size=(96, 128))


def test_empty_backdrop_is_even_and_things_stand_where_the_camera_sees_them(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    assert (picture[:10] == WHITE).all()
    blue = picture[..., 2].astype(int) - picture[..., 0] > 40
    where, _ = camera.project(BOX)
    rows, columns = np.nonzero(blue)
    assert columns.min() == pytest.approx(where[:, 0].min(), abs=1.5)
    assert columns.max() + 1 == pytest.approx(where[:, 0].max(), abs=1.5)
    assert rows.min() == pytest.approx(where[:, 1].min(), abs=1.5)


def test_shadow_lies_on_the_floor_and_away_from_the_lamp(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    grey = np.ptp(picture.astype(int), axis=2) <= 2
    rows, columns = np.nonzero(grey & (picture[..., 0] < WHITE - 15))
    (_, horizon), _ = camera.project(np.array([0.0, 1e6, 0.0]))
    assert rows.min() > horizon
    assert columns.mean() > 48  # the lamp stands to the left of the camera


def test_the_nearer_thing_hides_the_other(camera):
    near = ColouredMesh(BOX + [0, -1, 0], SIDES, (0.9, 0.1, 0.1))
    far = ColouredMesh(BOX + [0, 1, 0], SIDES, (0.1, 0.1, 0.9))
    for parts in ([near, far], [far, near]):
        middle = raytrace(parts, camera, samples=4)[60:66, 44:52].reshape(-1, 3).mean(0)
        assert middle[0] > middle[2] + 60


def test_a_half_covered_pixel_has_the_average_of_both_colours():
    """A wall whose upper edge runs through the middle of a row of pixels."""
    target = np.array([0.0, 0.0, 10.0])  # far above the floor, which is not seen
    camera = look_at(target - [0, 4, 0], target, focal_px=100, size=(20, 20))
    edge = 0.5 * 4 / 100  # half a pixel above the middle, at the wall's distance
    wall = np.array([[-9, 0, 5], [9, 0, 5], [9, 0, 10 + edge], [-9, 0, 10 + edge]], float)
    part = ColouredMesh(wall, np.array([[0, 1, 2, 3]]), (0.2, 0.2, 0.2))
    light = to_linear(raytrace([part], camera, samples=64)[:, 10] / 255)
    above, half, below = light[[5, 9, 15], 0]
    assert above == 1.0
    assert half == pytest.approx((above + below) / 2, abs=0.04)


def test_shadows_fade_out_with_distance_and_towards_the_borders(camera):
    """The floor under a roof so large that all of it lies in shadow."""
    roof = np.array([[-9, -9, 0.6], [9, -9, 0.6], [9, 9, 0.6], [-9, 9, 0.6]], float)
    above = look_at(np.array([0, -0.7, 0.5]), np.zeros(3), focal_px=60, size=(300, 200))
    part = ColouredMesh(roof, np.array([[0, 1, 2, 3]]), (0.5, 0.5, 0.5))
    picture = raytrace([part], above, samples=4)[..., 0].astype(int)
    column, row = np.meshgrid(np.arange(300) + 0.5, np.arange(200) + 0.5)
    rays = np.stack([(column - 150) / 60, (row - 100) / 60, np.ones_like(row)], -1) @ above.axes
    places = above.position - above.position[2] / rays[..., 2:] * rays
    away = np.where(rays[..., 2] < 0, np.linalg.norm(places[..., :2], axis=-1), np.inf)
    assert (picture[(away > FLOOR_REACH_M) & (rays[..., 2] < 0)] == WHITE).all()
    near = picture[away < 0.2 * FLOOR_REACH_M]
    assert near.max() < WHITE - 30
    middle = np.abs(away - 0.65 * FLOOR_REACH_M) < 0.05
    assert near.max() < picture[middle].mean() < WHITE
    assert (picture[-1] >= WHITE - 1).all()
    assert (picture[:, [0, -1]][rays[:, [0, -1], 2] < 0] >= WHITE - 1).all()


def to_linear(colour):
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


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
    np.testing.assert_array_equal(quick, ball_picture(2, samples=16))
    assert (quick != ball_picture(2)).any()


def test_with_less_than_a_ray_for_each_pixel_blocks_are_pixels_of_a_smaller_picture(camera):
    part = ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))
    with ray_share(1 / 16 / 64):
        coarse = raytrace([part], camera, samples=64)
    small = raytrace([part], camera.reduced(4), samples=1)
    np.testing.assert_array_equal(coarse, np.kron(small, np.ones((4, 4, 1), dtype=int)))
    assert np.ptp(coarse.astype(int)) > 100
    with ray_share(1 / 16 / 64):  # blocks at the right and at the bottom are cut off
        assert ball_picture(2).shape == (150, 150, 3)


def test_a_picture_lies_on_a_mesh_as_its_texture_coordinates_say():
    """Red, green, blue and grey quarters on a wall, which fills the view."""
    target = np.array([0.0, 0.0, 10.0])
    camera = look_at(target - [0, 4, 0], target, focal_px=100, size=(40, 40))
    wall = target + np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    quarters = np.array([[[200, 0, 0], [0, 200, 0]], [[0, 0, 200], [200, 200, 200]]], np.uint8)
    picture = quarters.repeat(64, axis=0).repeat(64, axis=1)
    corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    faces = np.array([[0, 1, 2, 3]])
    part = ColouredMesh(wall, faces, (0, 0, 0), texture=Texture(picture, corners, faces))
    seen = raytrace([part], camera, samples=16).astype(int)
    upper_left, upper_right = seen[10, 10], seen[10, 30]
    lower_left, lower_right = seen[30, 10], seen[30, 30]
    assert upper_left[0] > 100 > 20 > upper_left[1:].max()
    assert upper_right[1] > 100 > 20 > upper_right[[0, 2]].max()
    assert lower_left[2] > 100 > 20 > lower_left[:2].max()
    assert lower_right.min() > 100


def test_a_fine_print_is_seen_as_its_mean_from_far_away():
    target = np.array([0.0, 0.0, 10.0])
    camera = look_at(target - [0, 4, 0], target, focal_px=100, size=(40, 40))
    wall = target + np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    faces = np.array([[0, 1, 2, 3]])
    lines = np.zeros((512, 512, 3), np.uint8)
    lines[::2] = 180
    grey = np.full((64, 64, 3), 90, np.uint8)
    fine, plain = (
        raytrace(
            [ColouredMesh(wall, faces, (1, 0, 0), texture=Texture(picture, corners, faces))],
            camera,
            samples=16,
        )
        for picture in (lines, grey)
    )
    middle = slice(5, 35)
    # The lines differ by 180 of 255; blocks of an odd number of them still do a little.
    assert np.abs(fine[middle, middle].astype(int) - plain[middle, middle]).max() <= 18
