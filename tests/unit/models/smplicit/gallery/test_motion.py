"""Garments at rest in other poses, against the rest pose and the body's own vertices."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import BodyInside
from drapeline.models.smplicit.gallery.motion import garment_weights, repose
from drapeline.seeding import rng_for

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)
POSES = REST_POSE + 0.4 * rng_for(0, "poses").normal(size=(3, 72))


@pytest.fixture(scope="module")
def worn(toy_body):
    """The body's own surface, one centimetre larger in every direction from its middle line."""
    vertices = rest_body(toy_body, SHAPE)
    return Mesh((1.02 * vertices).astype(np.float32), toy_body.faces)


@pytest.mark.parametrize("skinning", ["nearest", "smoothed"])
def test_the_rest_pose_leaves_every_vertex(toy_body, worn, skinning):
    moved = repose(worn, toy_body, SHAPE, REST_POSE[None], skinning=skinning)
    assert moved[0] == pytest.approx(worn.vertices, abs=1e-6)


def test_the_bodys_own_vertices_move_with_it(toy_body):
    skin = Mesh(rest_body(toy_body, SHAPE).astype(np.float32), toy_body.faces)
    posed, _ = posed_vertices(toy_body, SHAPE, POSES)
    assert repose(skin, toy_body, SHAPE, POSES) == pytest.approx(posed, abs=2e-6)


def test_a_turn_of_the_root_turns_every_garment(toy_body, worn):
    turned = REST_POSE.copy()
    turned[:3] = [0, 0, np.pi]
    for skinning in ("nearest", "smoothed"):
        moved = repose(worn, toy_body, SHAPE, turned[None], skinning=skinning)[0]
        # From +90 degrees about X to 180 about Z: (x, y, z) -> (-x, -z, -y) in the world's axes.
        expected = worn.vertices[:, [0, 2, 1]] * [-1, -1, -1]
        assert moved == pytest.approx(expected, abs=1e-5)


def test_nearest_weights_are_those_of_the_nearest_body_vertex(toy_body, worn):
    points = worn.vertices[::50]
    rest = rest_body(toy_body, SHAPE)
    nearest = np.linalg.norm(points[:, None] - rest, axis=2).argmin(axis=1)
    found = garment_weights(Mesh(points, worn.faces[:0]), toy_body, SHAPE)
    assert np.array_equal(found, toy_body.weights[nearest])


def test_smoothed_weights_differ_less_between_neighbours(toy_body, worn):
    along = [
        np.abs(np.diff(garment_weights(worn, toy_body, SHAPE, skinning)[worn.faces], axis=1)).max()
        for skinning in ("nearest", "smoothed")
    ]
    assert along[1] < 0.5 * along[0]


def test_pushed_out_vertices_are_outside(toy_body):
    sunk = Mesh((0.97 * rest_body(toy_body, SHAPE)).astype(np.float32), toy_body.faces)
    poses = REST_POSE[None]
    body, _ = posed_vertices(toy_body, SHAPE, poses)
    deep = [
        BodyInside(body[0], toy_body.faces)
        .depth(repose(sunk, toy_body, SHAPE, poses, push_out=push)[0])
        .max()
        for push in (False, True)
    ]
    assert deep[0] > 0.005
    assert deep[1] < 0.001


def test_cloth_outside_the_body_is_not_pushed(toy_body):
    far = Mesh((rest_body(toy_body, SHAPE) + [0, 1.0, 0]).astype(np.float32), toy_body.faces)
    poses = REST_POSE[None]
    pushed, left = (repose(far, toy_body, SHAPE, poses, push_out=push) for push in (True, False))
    assert np.array_equal(pushed, left)


def test_no_poses_give_no_frames(toy_body, worn):
    moved = repose(worn, toy_body, SHAPE, np.zeros((0, 72)), push_out=True)
    assert moved.shape == (0, len(worn.vertices), 3)


def test_bad_input_is_refused(toy_body, worn):
    with pytest.raises(InputError, match="'rigid', expected one of nearest, smoothed"):
        repose(worn, toy_body, SHAPE, POSES, skinning="rigid")
    with pytest.raises(InputError, match=r"poses: shape \(72,\), expected \(frames, 72\)"):
        repose(worn, toy_body, SHAPE, POSES[0])
