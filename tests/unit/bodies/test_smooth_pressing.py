"""Corrections of self-collisions over time."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.self_collision import PAIRS, body_parts, solve_self_collisions
from drapeline.bodies.smooth_pressing import smooth_corrections
from drapeline.frames import JOINT_NAMES, REST_POSE
from toys.colliding_balls import two_balls

GAP_M = 0.004
FRAMES = 40


@pytest.fixture(scope="module")
def solved(toy_body):
    """A body that lowers its arms into the trunk and lifts them again, turning round."""
    poses = np.tile(REST_POSE, (FRAMES, 1))
    angles = 0.9 + 0.5 * np.sin(np.pi * np.arange(FRAMES) / FRAMES)
    for side, sign in (("left", -1), ("right", 1)):
        poses[:, 3 * JOINT_NAMES.index(f"{side}_shoulder") + 2] = sign * angles
    poses[:, 2] = 0.1 * np.arange(FRAMES)
    vertices, _ = posed_vertices(toy_body, np.zeros(10), poses)
    parts = body_parts(toy_body)
    one_by_one = solve_self_collisions(vertices, parts, gap_m=GAP_M)
    smooth = smooth_corrections(
        vertices, poses, toy_body.segmentation, parts, one_by_one, gap_m=GAP_M
    )
    return vertices, poses, parts, one_by_one, smooth


def moves(vertices, solution):
    found = np.zeros_like(vertices)
    found[solution.frame, solution.vertex] = solution.delta
    return found


def jumps(moved):
    return np.sqrt((np.diff(moved, 2, axis=0) ** 2).sum(axis=2).mean())


def test_corrections_jump_much_less_than_frame_by_frame(solved):
    vertices, _, _, one_by_one, smooth = solved
    assert 0 < jumps(moves(vertices, smooth)) < 0.4 * jumps(moves(vertices, one_by_one))


def test_parts_that_were_pressed_apart_stay_apart(solved):
    vertices, _, parts, one_by_one, smooth = solved
    assert one_by_one.depth_m.max() > 0.003
    again = solve_self_collisions(vertices + moves(vertices, smooth), parts, gap_m=GAP_M)
    assert again.depth_m.max() < 0.001


def test_the_gap_is_kept_in_all_frames():
    """Two balls for thighs come together and part again."""
    vertices, parts = two_balls(radius_m=0.05, apart_m=0.09)
    half = len(vertices) // 2
    apart_m = 0.02 * (np.arange(FRAMES) / FRAMES * 2 - 1) ** 2  # from overlap of 10 mm to free
    moving = np.repeat(vertices[None], FRAMES, axis=0)
    moving[:, half:, 0] += apart_m[:, None]
    solution = solve_self_collisions(moving, parts, gap_m=GAP_M)
    smooth = smooth_corrections(
        *(moving, np.zeros((FRAMES, 72)), np.zeros(2 * half, dtype=int), parts, solution),
        gap_m=GAP_M,
    )
    moved = moving + moves(moving, smooth)
    gaps = moved[:, half:, 0].min(axis=1) - moved[:, :half, 0].max(axis=1)
    met = (solution.depth_m > 0).any(axis=1)
    assert 10 < met.sum() < 40
    assert (gaps[met] > 0.9 * GAP_M).all()
    assert (gaps[~met] > 0).all()


def test_a_body_without_collisions_is_left_alone(toy_body, solved):
    vertices, poses, parts, *_ = solved
    free = solve_self_collisions(vertices[:2], parts, gap_m=GAP_M)
    same = smooth_corrections(
        vertices[:2], poses[:2], toy_body.segmentation, parts, free, gap_m=GAP_M
    )
    assert len(free.frame) == len(same.frame) == 0


def test_what_is_left_out_is_not_pressed_apart(solved):
    vertices, _, parts, *_ = solved
    no_arms = [not any("arm" in name for name in (pair.first, pair.second)) for pair in PAIRS]
    suspects = np.tile(no_arms, (FRAMES, 1))
    kept = solve_self_collisions(vertices, parts, gap_m=GAP_M, suspects=suspects)
    assert not kept.depth_m[:, ~suspects[0]].any()


def test_what_is_too_deep_in_one_frame_takes_its_place_from_the_frames_around(toy_body, solved):
    vertices, poses, parts, one_by_one, smooth = solved
    frame = FRAMES // 2
    pair = one_by_one.depth_m[frame].argmax()
    thrown = one_by_one.delta.copy()
    thrown[one_by_one.frame == frame] *= 20
    depth_m = one_by_one.depth_m.copy()
    depth_m[frame] *= 20
    limit_m = np.full(depth_m.shape[1], 2 * one_by_one.depth_m.max())
    wrong = replace(one_by_one, delta=thrown, depth_m=depth_m, limit_m=limit_m)
    assert depth_m[frame, pair] > limit_m[pair]
    again = smooth_corrections(vertices, poses, toy_body.segmentation, parts, wrong, gap_m=GAP_M)
    usual = np.abs(moves(vertices, smooth)).max()
    assert np.abs(moves(vertices, again)).max() < 2 * usual
