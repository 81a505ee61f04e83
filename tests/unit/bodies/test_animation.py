"""A motion on a body: corrections, outcomes, the floor."""

import numpy as np
import pytest

from drapeline.bodies import animation
from drapeline.bodies.animation import (
    first_free_sequence,
    leg_length_m,
    make_body_sequence,
    place_on_floor,
)
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.self_collision import solve_self_collisions
from drapeline.bodies.sequence import ClipLabels, body_sequence_vertices, collision_faces
from drapeline.frames import JOINT_NAMES, REST_POSE


def test_path_is_scaled_by_leg_length():
    vertices = np.zeros((3, 2, 3))
    vertices[:, 1, 2] = -0.9
    trans = np.array([[5.0, 6, 0.6], [6, 6, 0.6], [5, 8, 0.8]])
    path = place_on_floor(vertices, trans, 1.5)
    np.testing.assert_allclose(path[0, :2], [5, 6])
    np.testing.assert_allclose(np.diff(path, axis=0), 1.5 * np.diff(trans, axis=0))
    assert path[:, 2].min() == pytest.approx(0.9)


def test_leg_length_of_the_toy(toy_body):
    assert leg_length_m(toy_body, np.zeros(10)) == pytest.approx(0.79, abs=0.005)


def arms_down(angles_rad):
    poses = np.tile(REST_POSE, (len(angles_rad), 1))
    for side, sign in (("left", -1), ("right", 1)):
        poses[:, 3 * JOINT_NAMES.index(f"{side}_shoulder") + 2] = sign * np.array(angles_rad)
    return poses


def sequence(body, angles_rad, **options):
    trans = np.tile([1.0, 2.0, 0.95], (len(angles_rad), 1))
    shape = options.pop("shape", np.zeros(10))
    return make_body_sequence(body, shape, arms_down(angles_rad), trans, gender="female", **options)


def test_free_sequence_is_the_posed_body(toy_body):
    record = sequence(toy_body, [0.2, 0.4, 0.6])
    assert record.outcome == "free"
    assert record.reason == ""
    assert record.collided_frames == 0
    expected, _ = posed_vertices(toy_body, np.zeros(10), record.poses)
    np.testing.assert_array_equal(body_sequence_vertices(toy_body, record), expected)
    np.testing.assert_array_equal(collision_faces(toy_body, record), toy_body.faces)


def test_shallow_collisions_are_solved_and_replayed(toy_body):
    record = sequence(toy_body, [0.4] * 10 + [1.38] + [0.6] * 10)
    assert record.outcome == "solved"
    assert record.collided_frames == 1
    plain, _ = posed_vertices(toy_body, np.zeros(10), record.poses)
    change = np.abs(body_sequence_vertices(toy_body, record) - plain).max(axis=(1, 2))
    assert change[10] > 0.002
    assert change[[0, 20]].max() == 0
    assert record.deepest_m == pytest.approx(np.linalg.norm(record.fix_delta, axis=1).max(), 0.01)


def test_deep_collision_is_rejected_with_its_reason(toy_body):
    record = sequence(toy_body, [0.4, 1.8])
    assert record.outcome == "rejected"
    assert "overlap by" in record.reason
    assert "frame 1" in record.reason


@pytest.mark.parametrize(
    ("removable", "limb"), [("hands", {"wrist", "hand"}), ("forearms", {"elbow", "wrist", "hand"})]
)
def test_bare_limbs_are_left_out_instead(toy_body, removable, limb):
    poses = arms_down([0.4, 1.2])
    for side, sign in (("left", -1), ("right", 1)):
        poses[1, 3 * JOINT_NAMES.index(f"{side}_elbow") + 2] = sign * 2.0
    record = make_body_sequence(
        toy_body, np.zeros(10), poses, np.zeros((2, 3)), gender="female", removable=removable
    )
    assert record.outcome == "removed"
    names = {JOINT_NAMES[j] for j in record.removed_segments}
    assert names == {f"{side}_{joint}" for side in ("left", "right") for joint in limb}
    kept = collision_faces(toy_body, record)
    gone = np.isin(toy_body.segmentation, record.removed_segments)
    assert 0 < len(kept) < len(toy_body.faces)
    assert not gone[kept].any()


def test_another_shape_is_taken_only_where_one_is_rejected(toy_body):
    trans = np.tile([1.0, 2.0, 0.95], (2, 1))
    for angles, redrawn, outcome in (([0.2, 0.4], 0, "free"), ([0.4, 1.8], 2, "rejected")):
        shapes = iter([np.full(10, value) for value in (0.0, 0.1, 0.2)])
        record = first_free_sequence(toy_body, shapes, arms_down(angles), trans, gender="female")
        assert (record.redrawn, record.outcome) == (redrawn, outcome)
        assert len(list(shapes)) == 2 - redrawn
        assert record.shape[0] == pytest.approx(0.1 * redrawn)


def test_what_stopped_one_body_is_looked_at_first_in_the_next(toy_body, monkeypatch):
    orders = []

    def solve(*given, order=None, **options):
        orders.append(None if order is None else list(order))
        return solve_self_collisions(*given, order=order, **options)

    monkeypatch.setattr(animation, "solve_self_collisions", solve)
    angles = [0.4] * 17 + [1.8] * 2 + [0.4] * 6
    trans = np.tile([1.0, 2.0, 0.95], (len(angles), 1))
    shapes = [np.zeros(10), np.full(10, 0.1)]
    first_free_sequence(toy_body, shapes, arms_down(angles), trans, gender="female")
    assert orders[0][:4] == [0, 10, 20, 1]
    assert len(orders) > 3
    for order in orders[1:-1]:
        assert order[:4] == [17, 16, 18, 15]
    assert orders[-1] is None


def test_fat_body_is_made_thinner(toy_body):
    """The toy's second coefficient adds volume, SMPL's may do either: the sign is found."""
    shape = np.zeros(10)
    shape[1] = 3.0
    angle = next(
        a for a in np.arange(1.3, 1.8, 0.02)
        if sequence(toy_body, [a], shape=shape).outcome in ("thinned", "rejected")
    )  # fmt: skip
    record = sequence(toy_body, [0.3, angle], shape=shape)
    assert record.outcome == "thinned"
    assert record.thinned >= 1
    assert record.shape[1] == pytest.approx(3.0 - record.thinned)


def test_no_body_is_made_thinner_than_shapes_are_drawn(toy_body):
    """At an angle at which the body of mean corpulence has to be thinner, and may or may not."""
    assert sequence(toy_body, [1.6]).outcome == "thinned"
    record = sequence(toy_body, [1.6], shape_range=0.5)
    assert (record.outcome, record.thinned) == ("rejected", 0)
    np.testing.assert_array_equal(record.shape, np.zeros(10))


def test_feet_stand_on_the_floor(toy_body):
    record = sequence(toy_body, [0.2] * 4, reference_leg_length_m=0.5, adapt=False)
    world = body_sequence_vertices(toy_body, record, world=True)
    assert world[..., 2].min() == pytest.approx(0, abs=1e-5)
    assert record.penetration_m == pytest.approx(0, abs=1e-5)
    assert record.sliding_m_s == pytest.approx(0, abs=1e-5)


def test_labels_are_kept(toy_body):
    labels = ClipLabels("walk_s0", "walk", "7", "walk.bvh", 60)
    assert sequence(toy_body, [0.4], labels=labels).labels == labels
