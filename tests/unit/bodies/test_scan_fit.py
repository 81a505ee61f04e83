import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.scan_fit import fit_body, fit_sequence, is_exact
from drapeline.bodies.settings import BodyFit
from drapeline.frames import REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import face_normals, vertex_normals

TRUE = BodyState.of(
    REST_POSE + np.random.default_rng(0).normal(scale=0.2, size=72),
    np.array([0.3, -0.2, 0.9]),
    np.array([0.8, -0.6, *np.zeros(8)]),
)


def vertices(body, state):
    return posed_vertices(body, state.shape, state.pose[None], state.trans[None])[0][0]


def estimate(pose_rad=0.06, place_m=0.02):
    rng = np.random.default_rng(1)
    turned = TRUE.pose + rng.normal(scale=pose_rad, size=72)
    return BodyState.of(turned, TRUE.trans + rng.normal(scale=place_m, size=3), np.zeros(10))


def error_mm(body, state):
    return 1000 * np.linalg.norm(vertices(body, state) - vertices(body, TRUE), axis=1).mean()


def joints(body):
    return posed_vertices(body, TRUE.shape, TRUE.pose[None], TRUE.trans[None])[1][0]


@pytest.fixture(scope="module")
def points(toy_body):
    """The body's own vertices."""
    return vertices(toy_body, TRUE)


def fitted(body, points, skin, given, joints=None, **settings):
    rng = np.random.default_rng(2)
    return fit_body(body, points, skin, given, joints, BodyFit(**settings), rng)


@pytest.mark.portable
def test_a_naked_body_is_found_from_its_points(toy_body, points):
    start = estimate()
    found = fitted(toy_body, points, np.ones(len(points), bool), start, joints(toy_body))
    assert error_mm(toy_body, start) > 20
    assert error_mm(toy_body, found) < 6


@pytest.mark.portable
def test_joints_alone_bring_the_body_near(toy_body, points):
    none = np.zeros((1, 3)), np.ones(1, bool)
    found = fitted(toy_body, *none, estimate(), joints(toy_body), steps=0, joint_steps=8)
    away = posed_vertices(toy_body, found.shape, found.pose[None], found.trans[None])[1][0]
    assert np.linalg.norm(away - joints(toy_body), axis=1).mean() < 0.02


@pytest.mark.portable
@pytest.mark.parametrize("start", [-3.5, -0.5])
def test_cloth_holds_a_body_that_sticks_out_of_it(toy_body, start):
    """The prior alone makes a slim body fat; cloth 2 cm off the slim one stops it half-way."""
    slim, first = (
        TRUE._replace(shape=np.array([0.8, thick, *np.zeros(8)])) for thick in (-3.5, start)
    )
    nothing = np.full((1, 3), 50.0)
    held, free = (
        fitted(toy_body, points, np.zeros(len(points), bool), first, joint_steps=0)
        for points in (loose_cloth(toy_body, slim), nothing)
    )
    assert free.shape[1] == pytest.approx(0, abs=1e-6)
    assert -2.5 < held.shape[1] < -0.7


def test_cloth_says_nothing_of_the_body_below_it(toy_body):
    cloth = loose_cloth(toy_body, TRUE)
    found = fitted(toy_body, cloth, np.zeros(len(cloth), bool), TRUE, joint_steps=0)
    assert found.shape[1] == pytest.approx(0, abs=0.1)  # the prior's, as without any points


def loose_cloth(body, state):
    """Points 2 cm off the middles of faces, where no other face is as close."""
    points, faces = vertices(body, state), body.faces
    cloth = points[faces].mean(axis=1) + 0.02 * face_normals(points, faces)
    place, _ = closest_points(cloth, points, faces)
    return cloth[np.linalg.norm(cloth - place, axis=1) > 0.0199]


def test_nothing_to_see_leaves_the_estimate(toy_body):
    start = estimate()._replace(shape=np.zeros(10))
    far = np.full((1, 3), 50.0)
    found = fitted(toy_body, far, np.zeros(1, bool), start, steps=2, joint_steps=2)
    np.testing.assert_allclose(found.rotations, start.rotations, atol=1e-9)
    np.testing.assert_allclose(found.trans, start.trans, atol=1e-9)


@pytest.fixture(scope="module")
def walk():
    """Poses (8, 72) of a body whose shape is that of `TRUE`."""
    steps = np.random.default_rng(3).normal(scale=0.03, size=(8, 72))
    return TRUE.pose + np.cumsum(steps, axis=0)


def sequence(body, poses, shape, shift=0.0):
    """Vertices (F, V, 3) relative to the root joint as estimated."""
    return posed_vertices(body, shape, poses)[0] + shift


def off(rad=0.06):
    """By which an estimate of the walk is off: poses, shape and place."""
    rng = np.random.default_rng(4)
    shape = rng.normal(scale=0.4, size=10)
    return rng.normal(scale=rad, size=72), shape, rng.normal(scale=0.01, size=3)


@pytest.mark.portable
@pytest.mark.parametrize("known", [True, False])
def test_an_estimate_that_is_off_in_all_frames_alike_is_brought_nearer(toy_body, walk, known):
    points = sequence(toy_body, walk, TRUE.shape)
    turned, shape, place = off()
    poses, shape = walk + turned, TRUE.shape + shape
    skin = np.ones(points.shape[:2], bool) if known else None
    rng = np.random.default_rng(5)
    found = fit_sequence(toy_body, points + place, skin, poses, shape, rng)

    def error(poses, shape, shift):
        made = sequence(toy_body, poses, shape, shift)
        return np.linalg.norm(made - points - place, axis=-1).mean()

    assert found.poses.shape == walk.shape
    before, after = error(poses, shape, 0.0), error(*found)
    assert after < 0.5 * before


@pytest.mark.portable
def test_cloth_that_is_known_leaves_a_body_within_it_alone(toy_body, walk):
    """Half of the points are 3 cm outside."""
    points = sequence(toy_body, walk, TRUE.shape)
    normals = [vertex_normals(frame, toy_body.faces) for frame in points]
    skin = np.tile(np.arange(points.shape[1]) % 2 == 0, (len(points), 1))
    clothed = points + 0.03 * np.stack(normals) * ~skin[..., None]
    rng = np.random.default_rng(5)
    found = fit_sequence(toy_body, clothed, skin, walk, TRUE.shape, rng)
    made = sequence(toy_body, *found)
    assert np.linalg.norm(made - points, axis=-1).mean() < 0.003


def test_a_body_is_exact_if_a_tenth_of_the_points_are_its_skin(toy_body, walk):
    points = sequence(toy_body, walk, TRUE.shape).astype(np.float32)
    normals = np.stack([vertex_normals(frame, toy_body.faces) for frame in points])
    turned, _, place = off(0.1)
    assert is_exact(toy_body, points, walk, TRUE.shape)
    for share, expected in ((0.2, True), (0.05, False)):
        cloth = np.arange(points.shape[1]) >= share * points.shape[1]
        assert (
            is_exact(toy_body, points + 0.02 * normals * cloth[:, None], walk, TRUE.shape)
            == expected
        )
    assert not is_exact(toy_body, points, walk + turned, TRUE.shape)
    assert not is_exact(toy_body, points + place, walk, TRUE.shape)
