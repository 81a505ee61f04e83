import numpy as np
import pytest

from drapeline.bodies.follow import PosedBody
from drapeline.models.smplicit.pictures.fit import hidden_by_body, seen_points, space_points
from drapeline.rendering.camera import Camera
from toys.smplicit import tube

BODY = tube(0.15, -0.5, 0.5, around=64, rings=41)


def still(mesh):
    """A body that stays at rest."""
    turns = np.repeat(np.eye(3)[None], len(mesh.vertices), axis=0)
    vertices = mesh.vertices.astype(float)
    return PosedBody(vertices, vertices, turns, mesh.faces)


def camera_in_front(size=100, focal=100.0, away=2.0):
    """At (0, -away, 0), looking along Y with Z up."""
    intrinsics = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    to_camera = np.eye(4)
    to_camera[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    to_camera[2, 3] = away
    return Camera(intrinsics, to_camera, size, size)


def test_points_of_space_are_outside_the_body_and_within_reach():
    body = still(BODY)
    box = (np.full(3, -0.4), np.full(3, 0.4))
    points = space_points(np.random.default_rng(0), body, box, count=4000, reach_m=0.1)
    radius = np.linalg.norm(points[:, :2], axis=1)
    assert len(points) > 100
    assert (np.abs(points) <= 0.4).all()
    assert radius.min() > 0.148
    assert radius.max() < 0.251


def test_the_body_hides_what_is_behind_it():
    points = np.array([[0, -0.3, 0], [0, 0.3, 0], [0.3, 0.3, 0]], dtype=float)
    hidden = hidden_by_body(points, still(BODY), camera_in_front())
    assert hidden.tolist() == [False, True, False]


def test_points_fall_on_the_pixels_that_they_are_seen_at():
    camera, body = camera_in_front(), still(BODY)
    garment = np.zeros((100, 100), dtype=bool)
    garment[:50] = True  # the upper half of the picture
    unknown = np.zeros_like(garment)
    unknown[:, :40] = True
    points = np.array(
        [
            [0.0, -0.2, 0.3],  # above the middle
            [0.0, -0.2, -0.3],  # below it
            [0.0, 0.2, 0.3],  # behind the body
            [-0.35, -0.2, 0.3],  # where nothing is known
            [5.0, -0.2, 0.3],  # outside the picture
        ],
        dtype=np.float32,
    )
    seen = seen_points(points, body, camera, garment, unknown, neighbours=1, ray_m=0.01)
    assert seen.on.points.tolist() == points[:1].tolist()
    assert seen.off.points.tolist() == points[1:2].tolist()
    # From the pixel's middle to the nearest one of the garment, at the point's depth.
    row = int(50 + 100 * 0.3 / 1.8)
    assert seen.off.clearance_m[0] == pytest.approx((row - 49) * 1.8 / 100, rel=1e-5)
    assert seen.on.clearance_m[0] == 0


def test_rays_list_their_points():
    camera, body = camera_in_front(), still(BODY)
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-0.3, 0.3, (40, 3)) - [0, 0.5, 0]]).astype(np.float32)
    garment = np.ones((100, 100), dtype=bool)
    seen = seen_points(points, body, camera, garment, ~garment, neighbours=1, ray_m=0.1)
    assert len(seen.off) == 0
    index, own = seen.on.members(np.arange(len(seen.on)))
    assert sorted(index[own].tolist()) == list(range(40))
    for row, real in zip(index, own, strict=True):
        image, _ = camera.project(seen.on.points[row[real]].astype(float))
        side = round(0.1 * 100 / 1.5)
        squares = np.floor(image).astype(int) // side
        assert (np.abs(squares - squares[0]) <= 1).all()
