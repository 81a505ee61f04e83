"""Cameras: where points appear, and where to stand before somebody."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.frames import REST_POSE
from drapeline.rendering.camera import facing_direction, frame_points, look_at, view_direction

UPRIGHT = Rotation.from_rotvec(np.array(REST_POSE[:3]))


@pytest.fixture
def camera():
    """At y = -4, looking along +Y: X is to the right."""
    return look_at(np.array([0, -4, 1.0]), np.array([0, 0, 1.0]), focal_px=100, size=(60, 40))


def test_points_appear_where_a_pinhole_shows_them(camera):
    places, depth = camera.project(np.array([[0, 0, 1.0], [1, 0, 1], [0, -2, 1.5], [0, -5, 1]]))
    np.testing.assert_allclose(depth, [4, 4, 2, -1])
    np.testing.assert_allclose(places[:3], [[30, 20], [55, 20], [30, -5]])


def test_the_camera_is_where_it_was_put_and_stands_upright(camera):
    np.testing.assert_allclose(camera.position, [0, -4, 1])
    np.testing.assert_allclose(camera.axes, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)


def test_a_smaller_picture_shows_the_same_with_none_cut_off(camera):
    points = np.array([[0, 0, 1.0], [1, 0, 1], [0, -2, 1.5]])
    small = camera.reduced(7)
    assert (small.width, small.height) == (9, 6)  # of 60 and 40 pixels
    np.testing.assert_allclose(small.project(points)[0], camera.project(points)[0] / 7)


@pytest.mark.parametrize("turn_deg", [0, 90, 200])
def test_a_body_that_turns_about_the_vertical_faces_elsewhere(turn_deg):
    spin = Rotation.from_euler("z", turn_deg, degrees=True)
    expected = spin.apply([0, -1, 0])[:2]
    np.testing.assert_allclose(facing_direction((spin * UPRIGHT).as_rotvec()), expected, atol=1e-9)


def test_a_lying_body_is_seen_from_its_side():
    lying = Rotation.from_rotvec([-np.pi / 2, 0, 0]) * Rotation.from_rotvec(np.array(REST_POSE[:3]))
    front = np.array(facing_direction(lying.as_rotvec()))
    head = lying.apply([0.0, 1.0, 0.0])[:2]
    assert abs(front @ head) < 1e-6 * np.linalg.norm(front)
    np.testing.assert_allclose(facing_direction(REST_POSE[:3]), (0, -1), atol=1e-9)


def test_the_viewer_stands_before_the_subject_aside_and_above():
    np.testing.assert_allclose(
        view_direction((0, -2), turn_deg=0, rise=0.75), [0, -0.8, 0.6], atol=1e-12
    )
    np.testing.assert_allclose(view_direction((0, -1), turn_deg=90, rise=0), [1, 0, 0], atol=1e-12)


def test_framed_points_fill_the_picture_up_to_the_margin(camera):
    """The tallest view touches both margins; no other view leaves them."""
    points = [np.array([[0.3, 0, 0.0], [0.5, 0.2, 1.9]]), np.array([[-0.2, 0, 0.4], [0.1, 0, 1.5]])]
    other = look_at(np.array([2, -4, 1.0]), np.array([2, 0, 1.0]), focal_px=50, size=(60, 40))
    views = [camera, replace(camera, world_to_camera=other.world_to_camera)]
    framed = frame_points(views, [points[0], points[1] + [2, 0, 0]], 0.05)
    places = np.concatenate(
        [c.project(p)[0] for c, p in zip(framed, [points[0], points[1] + [2, 0, 0]], strict=True)]
    )
    low, high = places.min(axis=0), places.max(axis=0)
    assert low[1] == pytest.approx(2)
    assert high[1] == pytest.approx(38)
    assert low[0] + high[0] == pytest.approx(60)
    assert low[0] >= 3
    for before, after in zip(views, framed, strict=True):
        np.testing.assert_array_equal(before.world_to_camera, after.world_to_camera)
    assert len({c.intrinsics.tobytes() for c in framed}) == 1
