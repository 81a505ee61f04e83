import numpy as np
import pytest

from drapeline.bodies.follow import move, point_motions, pose_body
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.moved_body import UNKNOWNS, BodyState, MovedBody
from drapeline.frames import REST_POSE

STEP = 1e-3


@pytest.fixture(scope="module")
def state():
    rng = np.random.default_rng(0)
    pose = REST_POSE + rng.normal(scale=0.3, size=72)
    return BodyState.of(pose, np.array([0.3, -0.2, 0.9]), rng.normal(size=10))


def numeric(value, state):
    """(..., U) derivatives of a function of the state, by central differences."""
    columns = []
    for unknown in np.eye(UNKNOWNS):
        ahead, behind = (value(state.step(sign * STEP * unknown)) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * STEP))
    return np.stack(columns, axis=-1)


def test_states_keep_poses(state):
    again = BodyState.of(state.pose, state.trans, state.shape)
    np.testing.assert_allclose(again.rotations, state.rotations, atol=1e-9)


def test_turns_lead_from_one_state_to_the_other(state):
    change = np.zeros(UNKNOWNS)
    change[:72] = np.random.default_rng(1).normal(scale=0.3, size=72)
    np.testing.assert_allclose(state.step(change).turns_from(state), change[:72], atol=1e-7)


def test_vertices_and_joints_are_those_of_the_model(toy_body, state):
    moved = MovedBody(toy_body, state)
    posed, joints = posed_vertices(toy_body, state.shape, state.pose[None], state.trans[None])
    np.testing.assert_allclose(moved.vertices, posed[0], atol=1e-5)
    np.testing.assert_allclose(moved.joints, joints[0], atol=1e-5)


def test_slopes_of_joints_are_the_differences(toy_body, state):
    expected = numeric(lambda at: MovedBody(toy_body, at).joints.ravel(), state)
    np.testing.assert_allclose(MovedBody(toy_body, state).joint_slopes(), expected, atol=1e-4)


def test_slopes_of_vertices_are_the_differences(toy_body, state):
    ids = np.arange(0, len(toy_body.v_template), 97)
    along = np.random.default_rng(2).normal(size=(len(ids), 3))
    moved = MovedBody(toy_body, state)
    expected = numeric(
        lambda at: (MovedBody(toy_body, at).vertices[ids] * along).sum(axis=1), state
    )
    # Vertices are single precision.
    found = moved.slopes(moved.points_of_vertices(ids), along)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_points_on_faces_are_between_their_corners(toy_body, state):
    moved = MovedBody(toy_body, state)
    faces = toy_body.faces[::211]
    along = np.random.default_rng(3).normal(size=(len(faces), 3))
    share = np.tile([0.2, 0.3, 0.5], (len(faces), 1))
    corners = [moved.slopes(moved.points_of_vertices(faces[:, c]), along) for c in range(3)]
    found = moved.slopes(moved.points_of_faces(faces, share), along)
    # Skinning is bilinear in places and weights, so this holds exactly where weights agree.
    between = 0.2 * corners[0] + 0.3 * corners[1] + 0.5 * corners[2]
    assert np.abs(found - between).max() < 0.02 * np.abs(between).max()


def test_points_off_the_skin_turn_with_it(toy_body, state):
    rng = np.random.default_rng(4)
    ids = np.arange(5, len(toy_body.v_template), 131)
    offsets = rng.normal(scale=0.05, size=(len(ids), 3))
    along = rng.normal(size=(len(ids), 3))
    moved = MovedBody(toy_body, state)

    def value(at):
        body = pose_body(toy_body, at.shape, at.pose, at.trans)
        motions = point_motions(body.rest[ids], body, 1)
        return (move(body.rest[ids] + offsets, motions) * along).sum(axis=1)

    found = moved.slopes(moved.points_of_vertices(ids), along, offsets)
    np.testing.assert_allclose(found, numeric(value, state), atol=2e-3)
