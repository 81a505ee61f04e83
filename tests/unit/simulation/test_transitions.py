from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import posed_vertices
from drapeline.frames import REST_POSE
from drapeline.simulation.transitions import (
    body_frames,
    place_at_start,
    rising_floor,
    transition_path,
    transition_poses,
)


def test_the_floor_rises_beneath_body_and_cloth_to_zero():
    floor_m = rising_floor(np.array([-0.3, -0.3, -0.1, 0.2]), -0.4, 6)
    np.testing.assert_allclose(floor_m, [-0.4, -0.4 * (1 - 5 / 32), -0.2, -0.4 * 5 / 32, 0, 0])
    floor_m = rising_floor(np.array([-0.3, -0.3, -0.25, 0.2]), 0.5, 5)
    np.testing.assert_allclose(floor_m, [-0.3, -0.3, -0.25, 0, 0])


def turns(poses):
    return Rotation.from_rotvec(poses.reshape(-1, 3))


def test_transition_of_a_still_pose_turns_every_joint_straight_there():
    first = np.array(REST_POSE)
    first[3 * 16 : 3 * 17] = [0, 0, -1.2]
    poses = transition_poses(first, first, 9)
    np.testing.assert_allclose(poses[0], REST_POSE, atol=1e-12)
    angle = poses.reshape(10, 24, 3)[:, 16, 2]
    assert np.all(np.diff(angle) < 0)
    assert angle[5] == pytest.approx(-0.6)  # half-way in the middle
    others = np.delete(poses.reshape(10, 24, 3), 16, axis=1)
    np.testing.assert_allclose(
        others,
        np.broadcast_to(np.delete(REST_POSE.reshape(24, 3), 16, axis=0), (10, 23, 3)),
        atol=1e-12,
    )


def test_transition_meets_the_sequence_at_its_speed():
    rng = np.random.default_rng(0)
    first, second = REST_POSE + 0.4 * rng.normal(size=(2, 72))
    second = first + 0.05 * (second - first)
    poses = transition_poses(first, second, 30)
    last = (turns(poses[-1]).inv() * turns(first)).as_rotvec()
    own = (turns(first).inv() * turns(second)).as_rotvec()
    assert np.linalg.norm(last - own) < 0.35 * np.linalg.norm(own)


@pytest.mark.parametrize("angle", [2.2, 2.3, 2.4])
def test_a_joint_keeps_the_direction_in_which_it_turns(angle):
    """The shortest way to where it was some frames before the sequence is the other one."""
    first, second = np.array(REST_POSE), np.array(REST_POSE)
    first[3 * 16 : 3 * 17] = [angle, 0, 0]
    second[3 * 16 : 3 * 17] = [angle - 0.3, 0, 0]
    shoulder = turns(transition_poses(first, second, 8)).as_matrix().reshape(9, 24, 3, 3)[:, 16]
    steps = Rotation.from_matrix(shoulder[:-1].swapaxes(1, 2) @ shoulder[1:]).magnitude()
    assert steps.max() < 0.8


def test_a_body_that_stands_on_its_head_does_so_from_the_beginning():
    first = np.array(REST_POSE)
    first[:3] = (Rotation.from_rotvec([0, np.pi, 0]) * Rotation.from_rotvec(first[:3])).as_rotvec()
    poses = transition_poses(first, first, 20)
    root = turns(poses).as_matrix().reshape(21, 24, 3, 3)[:, 0]
    np.testing.assert_allclose(root @ [0, 1, 0], np.tile([0, 0, -1], (21, 1)), atol=1e-12)
    np.testing.assert_allclose(poses[:, 3:], np.tile(REST_POSE[3:], (21, 1)), atol=1e-12)


def test_path_ends_at_speed_and_starts_at_rest():
    path = transition_path(np.array([1.0, 0, 0.9]), np.array([1.1, 0, 0.9]), 40)
    assert len(path) == 41
    steps = np.diff(path[:, 0])
    assert steps[0] == pytest.approx(0, abs=1e-4)
    assert steps[-1] == pytest.approx(0.1, rel=0.4)
    assert np.all(steps > 0)


@pytest.fixture
def record(toy_body):
    poses = np.tile(REST_POSE, (5, 1))
    poses[:, 3 * 16 + 2] = -0.3 + 0.01 * np.arange(5)
    trans = np.array([0.3, 0.1, 1.0]) + 0.02 * np.arange(5)[:, None]
    return make_body_sequence(toy_body, np.zeros(10), poses, trans, gender=0)


def test_frames_go_from_the_garments_shape_to_the_sequence(toy_body, record):
    wide = np.array([1.0, -1.0, *np.zeros(8)])
    frames = list(body_frames(toy_body, record, wide, shape_frames=3, pose_frames=4))
    assert len(frames) == 3 + 1 + 4 + 5
    for index, shape in ((0, wide), (3, record.shape)):
        rest = posed_vertices(toy_body, shape, REST_POSE[None].copy())[0][0]
        np.testing.assert_allclose(frames[index], place_at_start(rest, record, 4), atol=1e-5)
    own = posed_vertices(toy_body, record.shape, record.poses, record.trans)[0]
    np.testing.assert_allclose(np.stack(frames[-5:]), own, atol=1e-5)


def test_garments_begin_on_the_body_however_it_is_turned(toy_body, record):
    poses = record.poses.copy()
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0])
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    turned = replace(record, poses=poses)
    start = next(body_frames(toy_body, turned, record.shape, shape_frames=3, pose_frames=4))
    rest = posed_vertices(toy_body, record.shape, REST_POSE[None].copy())[0][0]
    np.testing.assert_allclose(place_at_start(rest, turned, 4), start, atol=1e-5)
    upright = place_at_start(rest, record, 4)
    middle = transition_path(record.trans[0], record.trans[1], 4)[0]
    np.testing.assert_allclose(start, turn.apply(upright - middle) + middle, atol=1e-5)


def test_corrections_of_the_first_frame_come_in_gradually(toy_body, record):
    vertex = 7
    fixed = replace(
        record,
        fix_frame=np.array([0], dtype=np.int32),
        fix_vertex=np.array([vertex], dtype=np.int32),
        fix_delta=np.array([[0, 0, 0.1]], dtype=np.float32),
    )
    arguments = {"shape_frames": 2, "pose_frames": 8}
    plain = np.stack(list(body_frames(toy_body, record, record.shape, **arguments)))
    moved = np.stack(list(body_frames(toy_body, fixed, record.shape, **arguments)))
    lift = (moved - plain)[:, vertex, 2]
    assert lift[2] == 0
    assert np.all(np.diff(lift[2:12]) > 0)
    assert lift[11] == pytest.approx(0.1, abs=1e-6)
    assert lift[12] == 0
