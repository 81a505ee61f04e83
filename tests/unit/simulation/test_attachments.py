import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.simulation.attachments import Carrier, Pins, elastic_shrinkage
from drapeline.simulation.collider import MovingBody


def tube(radius, rows=5, around=40, height=0.08):
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    z = np.linspace(0, height, rows)
    points = np.stack(
        [
            np.tile(radius * np.cos(angle), rows),
            np.tile(radius * np.sin(angle), rows),
            np.repeat(z, around),
        ],
        -1,
    )
    grid = np.arange(rows * around).reshape(rows, around)
    lower, upper = grid[:-1], grid[1:]
    faces = np.stack([lower, np.roll(lower, -1, 1), np.roll(upper, -1, 1), upper], -1)
    return points, faces.reshape(-1, 4)


def test_points_move_with_a_rigid_body_exactly():
    rng = np.random.default_rng(1)
    body = rng.normal(size=(300, 3))
    points = rng.normal(size=(20, 3))
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 2.0]), np.array([3.0, -1.0, 0.5])
    moved = Carrier(points, body)(turn.apply(body) + shift)
    np.testing.assert_allclose(moved, turn.apply(points) + shift, atol=1e-9)


def test_points_over_a_flat_body_stay_on_their_side_of_it():
    rng = np.random.default_rng(2)
    body = rng.normal(size=(100, 3)) * [1, 1, 0]
    points = rng.normal(size=(5, 3)) + [0, 0, 3]
    carrier = Carrier(points, body)
    for turn in Rotation.random(20, random_state=4):
        np.testing.assert_allclose(carrier(turn.apply(body)), turn.apply(points), atol=1e-9)


def test_points_follow_the_mean_of_a_swelling_body():
    body, _ = tube(0.1, rows=20, around=64, height=0.3)
    points, _ = tube(0.12)
    out = Carrier(points, body)(body * [1.2, 1.2, 1.0])
    radius = np.linalg.norm(out[:, :2], axis=1)
    assert radius == pytest.approx(np.full(len(points), 0.14), abs=0.004)


def test_pins_start_at_the_garment_and_move_with_the_body(tmp_path):
    body, faces = tube(0.1, rows=20, around=64, height=0.3)
    garment, _ = tube(0.12)
    write_point_cache(tmp_path / "body.pc2", [body, body + [0.3, 0.1, -0.2]])
    weights = np.zeros(len(garment))
    weights[[3, 8]] = 1, 0.5
    with PointCache(tmp_path / "body.pc2") as cache:
        moving = MovingBody(cache, faces, np.zeros(len(body), dtype=int))
        pins = Pins(weights, garment, moving)
        free = Pins(0 * weights, garment, moving)
        np.testing.assert_array_equal(pins.vertices, [3, 8])
        np.testing.assert_array_equal(pins.weights, [1, 0.5])
        np.testing.assert_allclose(pins.positions(0), garment[[3, 8]], atol=1e-6)
        np.testing.assert_allclose(pins.positions(1), garment[[3, 8]] + [0.3, 0.1, -0.2], atol=1e-6)
        assert free.positions(1).shape == (0, 3)
        assert not len(free.vertices)


def test_an_elastic_shrinks_by_what_it_stands_off():
    body, _ = tube(0.05, rows=60, around=120, height=0.08)
    points, faces = tube(0.075, rows=3, height=0.02)
    elastic = np.ones(len(points))
    elastic[40:80] = 0
    elastic[:40] = 0.5
    share = elastic_shrinkage(points + [0, 0, 0.03], faces, elastic, body, gap_m=0.005)
    assert np.all(share[40:80] == 0)
    # 20 mm too wide of a radius of 75 mm, and a little more so that it grips.
    assert share[80:] == pytest.approx(np.full(40, 20 / 75 + 0.05), abs=0.01)
    assert share[:40] == pytest.approx(share[80:] / 2)


def test_no_elastic_no_shrinking():
    points, faces = tube(0.1)
    assert not elastic_shrinkage(points, faces, np.zeros(len(points)), points, gap_m=0.004).any()
