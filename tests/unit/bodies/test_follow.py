import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.bodies.follow import (
    PosedBody,
    add_cloth,
    move,
    move_to_rest,
    near_vertices,
    point_motions,
    pose_body,
    pose_garment,
)
from drapeline.bodies.model import posed_vertices
from drapeline.frames import REST_POSE
from toys.smplicit import tube

TRANS = np.array([0.2, -0.1, 1.0])
CORE = tube(0.15, -0.5, 0.5, around=64, rings=41)
SHIFT = np.array([1.0, 2.0, 3.0])


def test_skin_follows_itself_into_the_pose(toy_body):
    pose = REST_POSE + np.random.default_rng(0).normal(scale=0.2, size=72)
    shape = np.linspace(-1, 1, 10)
    body = pose_body(toy_body, shape, pose, TRANS)
    expected, _ = posed_vertices(toy_body, shape, pose[None], TRANS[None])
    found = move(body.rest, point_motions(body.rest, body, 1))
    np.testing.assert_allclose(found, expected[0], atol=1e-4)


def test_at_rest_points_only_shift(toy_body):
    body = pose_body(toy_body, np.zeros(10), REST_POSE.copy(), TRANS)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    np.testing.assert_allclose(
        move(points, point_motions(points, body, 8)), points + TRANS, atol=1e-4
    )


def test_near_vertices_count_by_the_inverse_square_of_their_distance():
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [9, 0, 0]])
    near, share = near_vertices(np.array([[1.0, 0, 0]]), vertices, 2)
    assert near.tolist() == [[0, 1]]
    np.testing.assert_allclose(share, [[0.8, 0.2]])


def test_garments_move_with_the_body():
    turns = np.repeat(np.eye(3)[None], len(CORE.vertices), axis=0)
    rest = CORE.vertices.astype(float)
    body = PosedBody(rest, rest + SHIFT, turns, CORE.faces)
    garment = tube(0.2, -0.2, 0.2)
    posed = pose_garment(garment, body, neighbours=8, smoothing=20)
    np.testing.assert_allclose(posed.vertices, garment.vertices + SHIFT, atol=1e-5)


def test_points_on_the_skin_come_back_to_it(toy_body):
    pose = REST_POSE + np.random.default_rng(2).normal(scale=0.2, size=72)
    body = pose_body(toy_body, np.linspace(-1, 1, 10), pose, TRANS)
    found = move_to_rest(body.posed, body, 1)
    np.testing.assert_allclose(found.places, body.rest, atol=1e-4)
    np.testing.assert_allclose(found.offsets, 0, atol=1e-9)


def test_points_near_the_skin_come_back_to_where_they_were(toy_body):
    pose = REST_POSE + np.random.default_rng(3).normal(scale=0.05, size=72)
    body = pose_body(toy_body, np.zeros(10), pose, TRANS)
    points = body.rest[::29] + 0.001
    posed = move(points, point_motions(points, body, 1))
    np.testing.assert_allclose(move_to_rest(posed, body, 1).places, points, atol=1e-3)


def test_points_near_cloth_follow_it_and_others_the_body(toy_body):
    body = pose_body(toy_body, np.zeros(10), REST_POSE.copy(), TRANS)
    cloth = tube(0.3, -0.5, 0.0, around=64, rings=30).vertices.astype(float)
    turn = Rotation.from_rotvec([0.1, 0.4, 0.9])
    both = add_cloth(body, cloth, turn.apply(cloth) + SHIFT)
    assert both.faces is body.faces
    near_cloth = 1.005 * cloth
    found = move(near_cloth, point_motions(near_cloth, both, 4))
    np.testing.assert_allclose(found, turn.apply(near_cloth) + SHIFT, atol=1e-6)
    skin = body.rest[body.rest[:, 2] > 0.3]
    np.testing.assert_allclose(move(skin, point_motions(skin, both, 1)), skin + TRANS, atol=1e-4)


def test_folded_cloth_turns_and_is_not_mirrored(toy_body):
    body = pose_body(toy_body, np.zeros(10), REST_POSE.copy(), TRANS)
    rows, columns = np.meshgrid(np.arange(8) * 0.02, np.arange(8) * 0.02)
    flat = np.stack([rows.ravel(), columns.ravel(), np.zeros(64)], axis=1)
    over = flat * [-1, 1, -1]  # half a turn about Y
    turns = add_cloth(body, flat, over).turns[len(body.rest) :]
    np.testing.assert_allclose(np.linalg.det(turns), 1, atol=1e-9)
    np.testing.assert_allclose(turns, np.tile(np.diag([-1.0, 1, -1]), (64, 1, 1)), atol=1e-6)
