"""Pressing colliding body parts apart."""

from types import SimpleNamespace

import numpy as np
import pytest
from trimesh.creation import icosphere

from drapeline.bodies import self_collision
from drapeline.bodies.inside_parts import InsideParts
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.parts import PAIRS, PART_NAMES, body_parts
from drapeline.bodies.self_collision import segment_triangle_crossings, solve_self_collisions
from drapeline.frames import JOINT_NAMES, REST_POSE

GAP_M = 0.004


def pose(**turns):
    """Rest pose with some joints turned."""
    out = REST_POSE.copy()
    for name, turn in turns.items():
        at = 3 * JOINT_NAMES.index(name)
        out[at : at + 3] = turn
    return out


def arms_down(angle_rad):
    return pose(left_shoulder=(0, 0, -angle_rad), right_shoulder=(0, 0, angle_rad))


def legs_together(pose):
    """The thighs touch; nothing is too deep."""
    out = pose.copy()
    for side, turn in (("left", -0.2), ("right", 0.2)):
        out[3 * JOINT_NAMES.index(f"{side}_hip") + 2] += turn
    return out


def corrected(vertices, solution):
    out = vertices.copy()
    out[solution.frame, solution.vertex] += solution.delta
    return out


def collisions(solution, frame):
    return {
        (PAIRS[i].first, PAIRS[i].second): solution.depth_m[frame, i]
        for i in np.flatnonzero(solution.depth_m[frame])
    }


@pytest.fixture(scope="module")
def parts(toy_body):
    return body_parts(toy_body)


def solve(body, parts, *poses, **options):
    vertices, _ = posed_vertices(body, np.zeros(10), np.stack(poses))
    return vertices, solve_self_collisions(vertices, parts, gap_m=GAP_M, **options)


def test_segments_cross_triangles_where_geometry_says():
    triangle = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    through = [[0.2, 0.3, -1], [0.2, 0.3, 3]]
    beside = [[0.9, 0.9, -1], [0.9, 0.9, 1]]
    short = [[0.2, 0.3, -1], [0.2, 0.3, -0.1]]
    flat = [[0.1, 0.1, 0], [0.3, 0.3, 0]]
    segments = np.array([through, beside, short, flat], dtype=float)
    points = segment_triangle_crossings(segments, np.array([triangle] * 4, dtype=float))
    np.testing.assert_allclose(points, [[0.2, 0.3, 0]])


def test_open_pose_is_left_alone(toy_body, parts):
    _, solution = solve(toy_body, parts, REST_POSE, arms_down(0.8))
    assert len(solution.frame) == 0
    assert not solution.depth_m.any()
    assert not solution.unsolved().any()


def test_arm_that_grazes_the_torso_is_pressed_away(toy_body, parts):
    vertices, solution = solve(toy_body, parts, REST_POSE, arms_down(1.38))
    found = collisions(solution, 1)
    assert any("torso" in pair for pair in found)
    assert collisions(solution, 0) == {}
    assert set(solution.frame) == {1}
    assert not solution.unsolved().any()
    again = solve_self_collisions(corrected(vertices, solution), parts, gap_m=GAP_M)
    assert again.depth_m.max() < 0.5 * solution.depth_m.max()
    assert 0 < np.linalg.norm(solution.delta, axis=1).max() < 0.05


def test_separated_parts_lie_a_gap_apart():
    """Two balls for a body, left and right thigh; they overlap by 10 mm."""
    vertices, parts = two_balls(radius_m=0.05, apart_m=0.09)
    solution = solve_self_collisions(vertices[None], parts, gap_m=GAP_M)
    moved = corrected(vertices[None], solution)[0]
    half = len(vertices) // 2
    assert moved[half:, 0].min() - moved[:half, 0].max() == pytest.approx(GAP_M, abs=1e-4)
    assert set(collisions(solution, 0)) == {("left_thigh", "right_thigh")}
    # Each side gives way by half of the 10 mm overlap and of the gap.
    assert solution.depth_m.max() == pytest.approx(0.005 + GAP_M / 2, abs=1e-3)


def two_balls(radius_m, apart_m):
    """Vertices and parts of a left thigh at the origin and a right one along x."""
    ball = icosphere(subdivisions=4, radius=radius_m)
    count = len(ball.vertices)
    hips = [JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("right_hip")]
    body = SimpleNamespace(
        v_template=np.concatenate([ball.vertices, ball.vertices + np.array([apart_m, 0, 0])]),
        faces=np.concatenate([ball.faces, ball.faces + count]).astype(np.int32),
        segmentation=np.repeat(hips, count),
    )
    return body.v_template, body_parts(body)


def test_arms_pressed_into_the_torso_are_too_deep(toy_body, parts):
    _, solution = solve(toy_body, parts, arms_down(1.75))
    unsolved = {PAIRS[i].first for i in np.flatnonzero(solution.unsolved()[0])}
    assert unsolved & {"left_forearm", "left_upper_arm", "left_hand"}
    assert unsolved & {"right_forearm", "right_upper_arm", "right_hand"}


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0)])
def test_parts_that_are_too_deep_in_one_frame_are_left_out_of_all(
    toy_body, parts, order, monkeypatch
):
    """Both arms, deep in the second frame; elsewhere the same as if they had never touched."""
    limbs = ("hand", "forearm", "upper_arm")
    arms = frozenset(f"{side}_{limb}" for side in ("left", "right") for limb in limbs)
    cures = [arms & {pair.first, pair.second} and arms for pair in PAIRS]
    poses = (
        legs_together(arms_down(1.38)),
        arms_down(1.75),
        arms_down(1.38),
        legs_together(arms_down(0.8)),
    )
    solved = []
    solve_frame = self_collision._solve_frame
    monkeypatch.setattr(
        self_collision,
        "_solve_frame",
        lambda start, *others: solved.append(start) or solve_frame(start, *others),
    )
    vertices, solution = solve(toy_body, parts, *poses, cures=cures, order=order)
    assert solution.removed == arms
    assert not solution.unsolved().any()
    assert set(solution.frame) == {0, 3}
    found = [set(collisions(solution, frame)) for frame in range(4)]
    thighs = {("left_thigh", "right_thigh")}
    assert found == [thighs, set(), set(), thighs]
    pairs = [pair for i, pair in enumerate(PAIRS) if solution.leftover[:, i].any()]
    assert all(arms.isdisjoint((pair.first, pair.second)) for pair in pairs)
    both = (PART_NAMES.index(f"{side}_thigh") for side in ("left", "right"))
    legs = np.concatenate([parts.part_vertices[index] for index in both])
    assert set(solution.vertex) <= set(legs)
    moved = corrected(vertices, solution)
    # Rounding decides about vertices at the edge of a collision, and those hardly move.
    np.testing.assert_allclose(moved[0, legs], moved[3, legs], atol=0.002)
    assert sum(np.array_equal(start, vertices[3]) for start in solved) == 1


def test_a_collision_that_nothing_cures_ends_it(toy_body, parts):
    nothing = [frozenset()] * len(PAIRS)
    poses = arms_down(1.38), arms_down(1.75), arms_down(1.38)
    _, solution = solve(toy_body, parts, *poses, cures=nothing)
    assert solution.unsolved()[1].any()
    assert solution.removed == frozenset()
    assert collisions(solution, 0)
    assert collisions(solution, 2) == {}


def test_solution_moves_with_the_body(toy_body, parts):
    vertices, solution = solve(toy_body, parts, arms_down(1.38))
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=np.float32)
    moved = vertices @ turn.T + 3
    again = solve_self_collisions(moved, parts, gap_m=GAP_M)
    assert solution.depth_m.max() > 0.01
    # Rounding decides about vertices at the edge of a collision, and those hardly move.
    np.testing.assert_allclose(
        (corrected(moved, again) - 3) @ turn, corrected(vertices, solution), atol=0.005
    )


def test_parts_cover_the_body_and_pairs_are_unique(toy_body, parts):
    owned = np.concatenate(parts.part_vertices)
    np.testing.assert_array_equal(np.sort(owned), np.arange(len(toy_body.v_template)))
    pairs = [frozenset((pair.first, pair.second)) for pair in PAIRS]
    assert len(set(pairs)) == len(pairs)
    assert set().union(*pairs) == set(PART_NAMES)


def test_real_body_with_hanging_arms_is_solved(baked_bodies):
    for body in baked_bodies.values():
        parts = body_parts(body)
        vertices, solution = solve(body, parts, arms_down(0.9), arms_down(1.42))
        assert collisions(solution, 0) == {}
        assert any("torso" in pair for pair in collisions(solution, 1))
        assert not solution.unsolved().any()
        again = solve_self_collisions(corrected(vertices, solution), parts, gap_m=GAP_M)
        assert again.depth_m.max() < 0.005


def one_after_another(start, parts, pairs):
    """What `_solve_frame` moves, with each pair looked at when it is its turn."""
    find_inside = InsideParts(parts)
    vertices, active = start.copy(), list(pairs)
    for _ in range(self_collision.PASSES):
        before, crossing = vertices.copy(), []
        for pair in active:
            places = self_collision._Places(vertices, parts)
            (meeting,) = self_collision._meetings(
                vertices, before, parts, places, find_inside, [pair]
            )
            contact = self_collision._contact(vertices, parts, meeting, *pair)
            if contact is not None:
                crossing.append(pair)
                self_collision._separate(vertices, parts, contact, GAP_M)
        active = crossing
    return vertices


@pytest.mark.parametrize("angle_rad", [1.45, 1.6])
def test_a_pair_is_looked_at_again_after_its_parts_were_pressed(toy_body, parts, angle_rad):
    hunched = arms_down(angle_rad) + pose(left_elbow=(0, 0, -0.6)) - REST_POSE
    vertices, solution = solve(toy_body, parts, hunched)
    names = [[PART_NAMES.index(p.first), PART_NAMES.index(p.second)] for p in PAIRS]
    expected = one_after_another(vertices[0], parts, names)
    assert (solution.depth_m[0] > 0).sum() > 2
    np.testing.assert_allclose(corrected(vertices, solution)[0], expected, atol=1e-6)
