"""Pressing colliding body parts apart."""

import numpy as np
import pytest

from drapeline.bodies import self_collision
from drapeline.bodies.model import posed_vertices, shape_body
from drapeline.bodies.self_collision import (
    PAIRS,
    PART_JOINTS,
    PART_NAMES,
    InsideParts,
    body_parts,
    depth_limits,
    part_of_joint,
    segment_triangle_crossings,
    solve_self_collisions,
)
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import vertex_normals
from toys.colliding_balls import two_balls


@pytest.fixture(scope="module")
def parts(toy_body):
    return body_parts(toy_body)


def test_every_joint_moves_one_part():
    joints = [joint for names in PART_JOINTS.values() for joint in names]
    assert sorted(joints) == sorted(JOINT_NAMES)
    assert PART_NAMES[part_of_joint()[JOINT_NAMES.index("left_elbow")]] == "left_forearm"


def test_pairs_are_unique_and_the_same_on_both_sides():
    pairs = {frozenset((pair.first, pair.second)) for pair in PAIRS}
    assert len(pairs) == len(PAIRS)
    assert all(len(pair) == 2 for pair in pairs)

    def mirror(name):
        return name.replace("left", "*").replace("right", "left").replace("*", "right")

    limits = {frozenset((pair.first, pair.second)): pair.limit_m for pair in PAIRS}
    for pair, limit in limits.items():
        assert limits[frozenset(map(mirror, pair))] == limit


def test_parts_divide_the_vertices(parts, toy_body):
    ids = np.concatenate(parts.part_vertices)
    assert sorted(ids) == list(range(len(toy_body.v_template)))
    for own, edges in zip(parts.part_vertices, parts.part_edges, strict=True):
        assert np.isin(edges, own).all()


def test_every_vertex_knows_its_faces(parts, toy_body):
    for vertex in (7, 3, 200, 41):
        expected = np.flatnonzero((toy_body.faces == vertex).any(axis=1))
        np.testing.assert_array_equal(np.sort(parts.faces_of[vertex].indices), expected)


def test_what_is_around_vertices_shares_an_edge_with_one_of_them(parts):
    ids = np.array([12, 100])
    expected = np.flatnonzero(parts.neighbours[ids].toarray().any(axis=0))
    np.testing.assert_array_equal(parts.around(ids), expected)
    assert len(expected) > 8


def test_seams_reach_two_rings_into_the_neighbours(parts, toy_body):
    torso = PART_NAMES.index("torso")
    within = parts.seam[:, torso]
    assert within[parts.part_vertices[torso]].all()
    beyond = np.setdiff1d(np.flatnonzero(within), parts.part_vertices[torso])
    assert len(beyond)
    reach = np.zeros(len(toy_body.v_template))
    reach[parts.part_vertices[torso]] = 1
    assert (parts.neighbours @ (parts.neighbours @ reach))[beyond].all()


TORSO, LEFT, RIGHT = (
    PART_NAMES.index(name) for name in ("torso", "left_upper_arm", "right_upper_arm")
)


def arms_at(body, angle_rad):
    pose = REST_POSE.copy()
    pose[3 * JOINT_NAMES.index("left_shoulder") + 2] = -angle_rad
    pose[3 * JOINT_NAMES.index("right_shoulder") + 2] = angle_rad
    vertices = posed_vertices(body, np.zeros(10), pose[None])[0][0]
    # The toy is symmetric: without this, many vertices would be equally near.
    return vertices + np.random.default_rng(0).normal(0, 2e-4, vertices.shape).astype(np.float32)


def behind(vertices, before, faces, ids, others):
    """The rule, one by one: ids of vertices inside, and of those that rounding decides."""
    inside, unsure = [], []
    if not len(others):
        return inside, unsure
    normals = vertex_normals(before.astype(float), faces)
    for vertex in ids:
        ways = vertices[vertex].astype(float) - vertices[others]
        distance = np.linalg.norm(ways, axis=1)
        k = distance.argmin()
        away, height = distance[k], ways[k] @ normals[others[k]]
        steep = away < 0.015 or height < -0.5 * away
        if away < 0.06 and height < 0 and steep:
            inside.append(vertex)
        second = np.partition(distance, 1)[1]
        close = [away - 0.06, height, away - 0.015, height + 0.5 * away, second - away]
        if np.abs(close).min() < 1e-5:
            unsure.append(vertex)
    return inside, unsure


@pytest.mark.parametrize("angle_rad", [1.4, 1.5, 1.7])
def test_a_slow_twin_agrees(toy_body, parts, angle_rad):
    before = arms_at(toy_body, 0.9 * angle_rad)
    vertices = arms_at(toy_body, angle_rad)
    torso, left, right = (parts.part_vertices[part] for part in (TORSO, LEFT, RIGHT))
    questions = [(left, torso), (torso, left), (right[:0], torso), (right, torso), (torso, right)]
    found = InsideParts(parts)(vertices, before, questions)
    for (ids, others), inside in zip(questions, found, strict=True):
        expected, unsure = behind(vertices, before, parts.faces, ids, others)
        assert len(unsure) < 0.1 * len(ids) + 1
        np.testing.assert_array_equal(np.setdiff1d(inside, unsure), np.setdiff1d(expected, unsure))
    assert sum(map(len, found)) > 10


def test_answers_do_not_depend_on_what_was_asked_before(toy_body, parts):
    vertices = arms_at(toy_body, 1.5)
    torso, left, right = (parts.part_vertices[part] for part in (TORSO, LEFT, RIGHT))
    many = [(left, torso), (right, torso), (torso, left), (torso, right)] * 3
    find_inside = InsideParts(parts)
    few = find_inside(vertices, vertices, many[:1])
    all_of_them = find_inside(vertices, vertices, many)
    again = find_inside(vertices, vertices, many[:1])
    assert len(few[0])
    np.testing.assert_array_equal(few[0], all_of_them[0])
    np.testing.assert_array_equal(few[0], again[0])


def test_nothing_is_inside_nothing(toy_body, parts):
    vertices = arms_at(toy_body, 1.5)
    torso = parts.part_vertices[TORSO]
    find_inside = InsideParts(parts)
    assert find_inside(vertices, vertices, []) == []
    for question in ((torso[:0], torso), (torso, torso[:0]), (torso[:0], torso[:0])):
        (found,) = find_inside(vertices, vertices, [question])
        assert not len(found)


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


def test_thick_flesh_yields_more(toy_body, parts):
    fixed = np.array([pair.limit_m for pair in PAIRS])
    thin, thick = (
        depth_limits(parts, shape_body(toy_body, np.eye(10)[1] * corpulence)[0])
        for corpulence in (-3, 3)
    )
    assert (thin >= fixed - 1e-6).all()
    assert (thick >= thin).all()
    assert thick.max() > fixed.max() + 0.005


def test_depths_are_judged_by_the_limits_given(toy_body, parts):
    strict = np.full(len(PAIRS), 1e-4)
    _, solution = solve(toy_body, parts, arms_down(1.38), limit_m=strict)
    np.testing.assert_array_equal(solution.unsolved(), solution.depth_m > 1e-4)
    assert solution.unsolved().any()


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
    poses = arms_down(1.38), arms_down(1.75), arms_down(1.75), arms_down(1.38)
    _, solution = solve(toy_body, parts, *poses, cures=nothing)
    assert solution.unsolved()[1].any()
    assert solution.removed == frozenset()
    assert collisions(solution, 0)
    assert collisions(solution, 3) == {}


def test_one_frame_alone_is_not_too_deep_where_nothing_can_be_left_out(toy_body, parts):
    nothing = [frozenset()] * len(PAIRS)
    for deep in range(4):
        poses = [arms_down(1.38)] * 4
        poses[deep] = arms_down(1.75)
        _, solution = solve(toy_body, parts, *poses, cures=nothing)
        assert (solution.depth_m[deep] > solution.limit_m).any()
        assert not solution.unsolved().any()
        assert all(collisions(solution, frame) for frame in range(4))


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
