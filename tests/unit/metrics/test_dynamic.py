"""Metrics of garments in motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.skinning import skin_points
from drapeline.metrics.registered import measure_motion, measured_in_motion
from toys.moving import moving_garment


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_a_perfect_prediction_has_no_error_and_is_outside(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([1, 4])
    rows = measure_motion(moving, frames, moving.points(frames), toy_body, topology)
    assert [row["surface_error_mm"] for row in rows] == [0, 0]
    assert rows[0]["inside_1cm_share"] == 0
    assert "inside_share" not in rows[1]  # only every fifth frame


def test_cloth_inside_the_body_is_seen_in_its_pose(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([3])
    body = rest_body(toy_body, moving.shape)[moving.registered.vertex]
    inside = skin_points(
        body * [0.7, 0.7, 1],
        rest_to_pose(toy_body, moving.shape, moving.poses[frames]),
        moving.registered.weights,
    )
    (row,) = measure_motion(moving, frames, inside, toy_body, topology)
    assert row["inside_1cm_share"] > 0.8
    assert row["surface_error_mm"] > 20


def test_frames_of_one_sample_are_dependent(toy_body):
    moving = moving_garment(toy_body, "test", "Tshirt")
    measured = measured_in_motion(moving, [{"surface_error_mm": 1.0}, {"surface_error_mm": 2.0}])
    assert [one.group for one in measured] == [moving.sample] * 2
    assert [one.measures["surface_error_mm"] for one in measured] == [1.0, 2.0]
    assert {(one.garment, one.source) for one in measured} == {("Tshirt", moving.source)}
