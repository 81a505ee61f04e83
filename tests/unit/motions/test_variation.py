"""Pieces of motions at other speeds, and mirrored."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.frames import FPS, JOINT_NAMES
from drapeline.motions.motion import Motion
from drapeline.motions.variation import cut_piece, piece_frames, piece_span
from drapeline.seeding import rng_for


def steady_turn(frames=40):
    """An elbow that bends, and a root that walks, both at constant speed."""
    poses = np.zeros((frames, 72))
    poses[:, 3 * JOINT_NAMES.index("left_elbow") + 1] = 0.02 * np.arange(frames)
    trans = np.stack([0.01 * np.arange(frames), 0.03 * np.arange(frames), np.ones(frames)], 1)
    return Motion(poses, trans, float(FPS), "walk", "", "walk.npz", "walk")


def test_a_piece_at_the_clips_own_speed_is_a_part_of_it():
    clip = steady_turn()
    piece = cut_piece(clip, 5, 25)
    np.testing.assert_array_equal(piece.poses, clip.poses[5:25])
    np.testing.assert_array_equal(piece.trans, clip.trans[5:25])


@pytest.mark.parametrize("speed", [0.5, 0.8, 1.25, 2.0])
def test_speed_changes_how_far_one_frame_is_from_the_next(speed):
    clip = steady_turn()
    piece = cut_piece(clip, 4, 34, speed=speed)
    assert len(piece) == piece_frames(30, speed) == int(29 / speed) + 1
    np.testing.assert_allclose(np.diff(piece.trans[:, 1]), 0.03 * speed)
    bend = piece.poses[:, 3 * JOINT_NAMES.index("left_elbow") + 1]
    np.testing.assert_allclose(bend, 0.02 * (4 + speed * np.arange(len(piece))), atol=1e-9)


@pytest.mark.parametrize("speed", [0.8, 0.9371, 1.0, 1.2])
@pytest.mark.parametrize("frames", [2, 40, 60])
def test_the_span_of_a_piece_is_the_least_that_gives_its_frames(frames, speed):
    span = piece_span(frames, speed)
    assert piece_frames(span, speed) >= frames > piece_frames(span - 1, speed)


def test_a_mirrored_body_is_the_mirror_image(toy_body):
    rng = rng_for(1, "mirror")
    clip = steady_turn(3)
    clip = Motion(rng.normal(0, 0.4, (3, 72)), clip.trans, float(FPS), "", "", "", "")
    mirrored = cut_piece(clip, 0, 3, mirrored=True)
    np.testing.assert_allclose(mirrored.trans, clip.trans * [-1, 1, 1])
    joints = [posed_vertices(toy_body, np.zeros(10), m.poses)[1] for m in (clip, mirrored)]
    rest = posed_vertices(toy_body, np.zeros(10), np.zeros((1, 72)))[1][0]
    partner = [int(np.linalg.norm(rest - joint * [-1, 1, 1], axis=1).argmin()) for joint in rest]
    assert sorted(partner) == list(range(24))
    np.testing.assert_allclose(joints[1], joints[0][:, partner] * [-1, 1, 1], atol=5e-3)
    again = cut_piece(mirrored, 0, 3, mirrored=True)
    np.testing.assert_allclose(again.poses, clip.poses)
