"""Points between rest, T-pose and other poses, against the body's own vertices."""

import numpy as np
import pytest

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import posed_vertices, shape_body
from drapeline.bodies.rest_body import rest_body
from drapeline.frames import REST_POSE
from drapeline.models.smplicit.gallery.motion import straighten, tpose_motions
from drapeline.seeding import rng_for

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)


def test_the_bodys_rest_vertices_become_its_template(toy_body):
    vertices, joints = shape_body(toy_body, SHAPE)
    straight = straighten(rest_body(toy_body, SHAPE), toy_body.weights, toy_body, SHAPE)
    assert straight == pytest.approx(vertices - joints[0], abs=1e-5)


def test_skinning_with_the_motions_poses_the_body(toy_body):
    poses = REST_POSE + 0.4 * rng_for(0, "poses").normal(size=(3, 72))
    vertices, joints = shape_body(toy_body, SHAPE)
    motions = tpose_motions(toy_body, SHAPE, poses)
    posed, _ = posed_vertices(toy_body, SHAPE, poses)
    moved = skin_points(vertices - joints[0], motions, toy_body.weights)
    assert moved == pytest.approx(posed, abs=2e-6)


def test_the_pose_of_zeros_moves_nothing(toy_body):
    motions = tpose_motions(toy_body, SHAPE, np.zeros((1, 72)))
    still = np.broadcast_to(np.eye(3, 4), motions.shape)
    assert motions == pytest.approx(still, abs=1e-12)
