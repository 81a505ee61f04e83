from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.nets.garment4d.refine import (
    Cloth,
    RefineSettings,
    _SpaceTime,
    barycentric,
    body_push,
    pairs_across,
    point_pull,
    refined,
    worn_shares,
)
from drapeline.seeding import rng_for
from gcvae_toys import VERTICES, tube, tube_faces

FACES = tube_faces(False)
SETTINGS = RefineSettings()
FRAMES = 5


def on_surface(garment, count, rng):
    """(F, count, 3) random points on the faces of garments (F, N, 3)."""
    corners = garment[:, FACES[rng.integers(0, len(FACES), count)]]  # (F, count, 3, 3)
    shares = rng.dirichlet(np.ones(3), (len(garment), count))
    return (corners * shares[..., None]).sum(2)


def moving_tube():
    """(F, N, 3): turns and travels, without changing its lengths."""
    turn = Rotation.from_rotvec(np.outer(np.arange(FRAMES), [0.02, 0.05, 0.1])).as_matrix()
    travel = 0.02 * np.arange(FRAMES)[:, None, None] * np.array([1.0, 0.5, 0])
    return tube() @ turn.swapaxes(1, 2) + travel


def far_body(frames=FRAMES):
    """A body that is nowhere near."""
    place = np.tile([[[50.0, 0, 0], [51.0, 0, 0]]], (frames, 1, 1))
    return place, np.tile([[[1.0, 0, 0]]], (frames, 2, 1))


def fitted(start, points, rest=None, settings=SETTINGS, body=None, chosen=None, shares=None):
    chosen = np.ones(points.shape[:2], bool) if chosen is None else chosen
    body = far_body(len(start)) if body is None else body
    rest = tube() if rest is None else rest
    return refined(start, points, chosen, FACES, rest, *body, settings, shares)


def error_mm(made, true):
    return 1000 * np.linalg.norm(made - true, axis=-1).mean()


def test_a_garment_that_is_right_stays():
    true = moving_tube()
    made = fitted(true, on_surface(true, 400, rng_for(0, "stay")))
    assert made.dtype == np.float32
    assert error_mm(made, true) < 1


def test_a_displaced_and_rough_garment_is_taken_to_the_points():
    true, rng = moving_tube(), rng_for(0, "away")
    start = true + [0.02, -0.03, 0.02] + 0.01 * rng.normal(size=true.shape)
    made = fitted(start, on_surface(true, 400, rng))
    assert error_mm(start, true) > 40
    assert error_mm(made, true) < 6


def test_turning_everything_turns_the_result():
    true, rng = moving_tube(), rng_for(0, "turn")
    start, points = true + 0.01 * rng.normal(size=true.shape), on_surface(true, 300, rng)
    body = (0.5 * true, np.tile(rng.normal(size=true.shape[1:]), (FRAMES, 1, 1)))
    body[1][:] /= np.linalg.norm(body[1], axis=-1, keepdims=True)
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    move = np.array([0.3, 0.1, -0.2])
    made = fitted(start, points, body=body)
    again = fitted(
        start @ turn.T + move,
        points @ turn.T + move,
        rest=tube() @ turn,
        body=(body[0] @ turn.T + move, body[1] @ turn.T),
    )
    np.testing.assert_allclose(again, made @ turn.T + move, atol=1e-4)


def test_the_order_of_points_and_points_of_others_make_no_difference():
    true, rng = moving_tube(), rng_for(0, "order")
    start, points = true + 0.01, on_surface(true, 200, rng)
    wrong = np.concatenate([points, points + [0.1, 0, 0]], axis=1)
    chosen = np.repeat([[True, False]], 200, axis=1).repeat(FRAMES, axis=0)
    order = rng.permutation(400)
    made = fitted(start, wrong[:, order], chosen=chosen[:, order])
    np.testing.assert_allclose(made, fitted(start, points), atol=1e-5)


def test_lengths_come_back_and_worn_shares_are_kept_to():
    rest, none = tube(), np.zeros((1, 0, 3))
    settings = replace(SETTINGS, keep=1e-6, rounds=60)
    for share in (1.0, 0.9):
        shares = worn_shares([share * rest[None]], [rest], FACES)
        np.testing.assert_allclose(shares, share, atol=1e-9)
        made = fitted(1.1 * rest[None], none, settings=settings, shares=shares)[0]
        ratio = np.linalg.norm(made - np.roll(made, -1, 0), axis=1)
        ratio /= np.linalg.norm(rest - np.roll(rest, -1, 0), axis=1)
        np.testing.assert_allclose(np.median(ratio), share, atol=0.01)


def test_worn_shares_are_means_over_frames_and_sequences_with_one_of_the_mean():
    rest = tube()
    longer = rest * [1, 1, 1.5]
    shares = worn_shares([np.stack([rest, longer]), rest[None]], [rest, rest], FACES)
    length = np.abs(rest[:12] - rest[12:24])[:, 2]
    assert (length > 0).all()
    upright = 12 * 0 + 0  # the first edge of the first vertex is along the ring, the next upright
    pairs = np.concatenate([Cloth(rest, FACES, SETTINGS).pairs])
    along = (np.abs(rest[pairs[:, 0]] - rest[pairs[:, 1]])[:, :2] < 1e-9).all(1)
    mean = (shares * 3).mean() / 3
    first, second = np.ones(len(pairs)), np.ones(len(pairs))
    del upright, mean, first, second
    np.testing.assert_allclose(shares[along].std(), 0, atol=1e-9)


def test_smoothing_takes_out_jitter_and_leaves_steady_motion():
    steady = tube() + 0.01 * np.arange(12)[:, None, None] * np.array([1.0, 0, 0])
    none = np.zeros((12, 0, 3))
    settings = replace(SETTINGS, stretch=0, bend=0, smooth=10.0)
    np.testing.assert_allclose(fitted(steady, none, settings=settings), steady, atol=1e-5)
    rough = steady + 0.01 * rng_for(0, "jitter").normal(size=steady.shape)
    made = fitted(rough, none, settings=settings)
    assert np.abs(np.diff(made, 2, axis=0)).mean() < 0.2 * np.abs(np.diff(rough, 2, axis=0)).mean()


@pytest.mark.parametrize("frames", [1, 2, 6])
def test_the_solver_agrees_with_one_dense_system(frames):
    cloth = Cloth(tube(), FACES, SETTINGS)
    rng = rng_for(0, "dense")
    target, start = rng.normal(size=(2, frames, VERTICES, 3))
    springs = rng.normal(size=(VERTICES, frames * 3))
    made = _SpaceTime(cloth.stiffness, frames, SETTINGS)(target, springs, start)
    second = np.diff(np.eye(frames), 2, axis=0)
    matrix = np.kron(np.eye(frames), cloth.stiffness.toarray())
    matrix += np.kron(SETTINGS.smooth * second.T @ second, np.eye(VERTICES))
    matrix += (1 + SETTINGS.keep) * np.eye(len(matrix))
    right = target + SETTINGS.keep * start
    right += springs.reshape(VERTICES, frames, 3).transpose(1, 0, 2)
    wanted = np.linalg.solve(matrix, right.reshape(-1, 3)).reshape(target.shape)
    np.testing.assert_allclose(made, wanted, atol=1e-9)


def test_point_pull_is_a_weighted_mean_of_offsets():
    rng = rng_for(0, "pull")
    garment = np.stack([tube(), tube() + 0.3])
    points = on_surface(garment, 60, rng) + 0.01 * rng.normal(size=(2, 60, 3))
    chosen = rng.random((2, 60)) < 0.7
    made = point_pull(garment, points, chosen, FACES, 0.02)
    for frame in range(2):
        top, total = np.zeros((VERTICES, 3)), np.zeros(VERTICES)
        corners = garment[frame][FACES]
        for point in points[frame][chosen[frame]]:
            # Nearest of many places on every face: a slow twin good to a fraction of a mm.
            u, v = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
            inside = u + v <= 1 + 1e-9
            shares = np.stack([1 - u - v, u, v], -1)[inside]
            places = np.einsum("si,fij->fsj", shares, corners)
            away = np.linalg.norm(places - point, axis=-1)
            face, place = np.unravel_index(away.argmin(), away.shape)
            weight = 1 / (1 + (away[face, place] / 0.02) ** 2)
            for corner, share in zip(FACES[face], shares[place], strict=True):
                top[corner] += weight * share * (point - places[face, place])
                total[corner] += weight * share
        usual = chosen[frame].sum() / VERTICES
        wanted = top / np.maximum(total, usual)[:, None]
        assert np.abs(made[frame] - wanted).mean() < 2e-4
        assert np.abs(wanted).mean() > 1e-3


def test_frames_without_points_follow_the_others():
    true, rng = moving_tube(), rng_for(0, "gap")
    points = on_surface(true, 400, rng)
    chosen = np.ones(points.shape[:2], bool)
    chosen[2] = False
    settings = replace(SETTINGS, smooth=20.0)
    start = true + [0.0, 0.0, 0.03]
    made = fitted(start, points, chosen=chosen, settings=settings)
    assert error_mm(made[2], true[2]) < 0.6 * error_mm(start[2], true[2])
    nothing = fitted(true, points, chosen=np.zeros_like(chosen), settings=SETTINGS)
    assert error_mm(nothing, true) < 1


def test_vertices_inside_the_body_come_out_and_very_deep_ones_do_not():
    body = np.array([[[0.0, 0, 0]]])
    normal = np.array([[[0.0, 0, 1]]])
    garment = np.array([[[0.0, 0, 0.002], [0, 0, -0.03], [0, 0, -0.06], [0, 0, 0.2]]])
    nearest = np.zeros((1, 4), int)
    push = body_push(garment, body, normal, nearest, replace(SETTINGS, gap_m=0.003))
    np.testing.assert_allclose(push[0, :, 2], [0.001, 0.033, 0, 0], atol=1e-12)
    assert (push[..., :2] == 0).all()


def test_a_garment_is_taken_out_of_the_body():
    true = moving_tube()
    normals = tube() * [1, 1, 0] / 0.1
    turned = np.stack([normals] * FRAMES)
    start = true[:1].repeat(FRAMES, 0)
    body = (start * [1.2, 1.2, 1], turned)
    made = fitted(start, np.zeros((FRAMES, 0, 3)), rest=1.3 * tube(), body=body)
    before = (np.linalg.norm(start[..., :2], axis=-1) < 0.119).mean()
    after = (np.linalg.norm(made[..., :2], axis=-1) < 0.119).mean()
    assert before == 1
    assert after < 0.2


def test_pairs_across_face_one_another():
    faces = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    pairs = {tuple(sorted(pair)) for pair in pairs_across(faces).tolist()}
    assert pairs == {(0, 3), (1, 4)}


def test_barycentric_shares_give_the_points_back():
    rng = rng_for(0, "shares")
    corners = rng.normal(size=(50, 3, 3))
    shares = rng.dirichlet(np.ones(3), 50)
    points = (corners * shares[..., None]).sum(1)
    np.testing.assert_allclose(barycentric(points, corners), shares, atol=1e-9)
    flat = np.zeros((1, 3, 3))
    assert np.isfinite(barycentric(np.zeros((1, 3)), flat)).all()
