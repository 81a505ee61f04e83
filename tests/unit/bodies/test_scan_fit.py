import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.scan_fit import fit_body
from drapeline.bodies.settings import BodyFit
from drapeline.frames import REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import face_normals

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
