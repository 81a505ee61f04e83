"""Linear blend skinning: of bodies, with gradients, and of points there and back."""

from dataclasses import replace

import numpy as np
import torch

from drapeline.bodies.kinematics import (
    pose_feature,
    skin_body,
    skin_planes,
    skin_points,
    unskin_points,
)
from drapeline.bodies.model import posed_vertices, shape_body
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.frames import REST_POSE

SHAPE = np.linspace(-1, 1, 10)
POSES = REST_POSE + np.random.default_rng(0).normal(0, 0.4, (5, 72))


def test_planes_are_skinned_as_by_a_loop_over_points():
    rng = np.random.default_rng(0)
    planes, transforms = rng.normal(size=(2, 3, 7)), rng.normal(size=(2, 24, 3, 4))
    weights = rng.random((24, 7))
    found = skin_planes(planes, transforms, weights)
    for frame in range(2):
        for point in range(7):
            motion = np.einsum("j,jab->ab", weights[:, point], transforms[frame])
            expected = motion @ np.append(planes[frame, :, point], 1)
            np.testing.assert_allclose(found[frame, :, point], expected, atol=1e-12)


def test_the_pose_feature_leaves_out_the_root_and_vanishes_at_rest():
    rotations = np.tile(np.eye(3), (2, 24, 1, 1))
    rotations[:, 0] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert not pose_feature(rotations).any()
    rotations[1, 23, 2, 1] = 0.5
    assert np.argwhere(pose_feature(rotations)).tolist() == [[1, 205]]


def test_tensors_are_skinned_as_in_posed_vertices(toy_body):
    noise = np.random.default_rng(1).normal(0, 0.002, toy_body.posedirs.shape)
    body = replace(toy_body, posedirs=noise.astype(np.float32))
    rest, joints = shape_body(body, np.ones(10))
    vertices, _ = skin_body(
        *(torch.from_numpy(a) for a in (rest, joints, body.weights)),
        torch.tensor(POSES, dtype=torch.float32),
        torch.from_numpy(body.posedirs),
    )
    expected, _ = posed_vertices(body, np.ones(10), POSES)
    np.testing.assert_allclose(vertices.numpy() - joints[0], expected, atol=1e-5)


def test_gradients_of_skinning():
    rng = np.random.default_rng(0)

    def tensor(*shape, scale=1.0):
        return torch.tensor(rng.normal(0, scale, shape), requires_grad=True)

    arguments = (
        tensor(1, 3),
        tensor(24, 3),
        tensor(1, 24),
        tensor(2, 72, scale=0.5),
        tensor(1, 3, 207, scale=0.1),
    )
    assert torch.autograd.gradcheck(skin_body, arguments, fast_mode=True)


def test_points_of_the_body_move_as_it_does(toy_body):
    motions = rest_to_pose(toy_body, SHAPE, POSES)
    rigid = toy_body.weights.max(axis=1) > 1 - 1e-6
    expected = posed_vertices(toy_body, SHAPE, POSES)[0]
    found = skin_points(rest_body(toy_body, SHAPE), motions, toy_body.weights)
    np.testing.assert_allclose(found[:, rigid], expected[:, rigid], atol=1e-5)


def test_there_and_back_is_exact(toy_body):
    motions = rest_to_pose(toy_body, SHAPE, POSES)
    points = rest_body(toy_body, SHAPE) + np.random.default_rng(1).normal(0, 0.05, (5, 1, 3))
    rigid = np.eye(24)[toy_body.weights.argmax(axis=1)]
    for weights, tolerance in ((rigid, 1e-9), (toy_body.weights, 1e-5)):
        back = unskin_points(skin_points(points, motions, weights), motions, weights)
        np.testing.assert_allclose(back, points, atol=tolerance)
