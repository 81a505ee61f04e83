import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.registration.settings import RefineSettings
from drapeline.registration.to_points import (
    EdgeSprings,
    SeenSkin,
    SmoothnessSolver,
    WornGarmentStatistics,
    body_push,
    fit_to_points,
    point_pull,
    springs,
)
from drapeline.seeding import rng_for
from toys.gcvae import VERTICES, tube, tube_faces

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


def fitted(start, points, rest=None, settings=SETTINGS, body=None, chosen=None, **more):
    chosen = np.ones(points.shape[:2], bool) if chosen is None else chosen
    body = far_body(len(start)) if body is None else body
    rest = tube() if rest is None else rest
    return fit_to_points(start, points, chosen, FACES, rest, *body, settings, **more)


def statistics(shares=1.0, error_m=0.1, follow=0.0):
    """The same everywhere, unless (N,) or (K,) are given."""
    count = len(springs(FACES)[0])
    return WornGarmentStatistics(
        np.broadcast_to(shares, count),
        np.broadcast_to(error_m, VERTICES),
        np.broadcast_to(follow, VERTICES),
    )


def error_mm(made, true):
    return 1000 * np.linalg.norm(made - true, axis=-1).mean()


def test_a_garment_that_is_right_stays():
    true = moving_tube()
    made = fitted(true, on_surface(true, 400, rng_for(0, "stay")))
    assert made.dtype == np.float32
    assert error_mm(made, true) < 2


def test_a_displaced_and_rough_garment_is_taken_to_the_points():
    true, rng = moving_tube(), rng_for(0, "away")
    start = true + [0.02, -0.03, 0.02] + 0.01 * rng.normal(size=true.shape)
    made = fitted(start, on_surface(true, 400, rng))
    assert error_mm(start, true) > 40
    assert error_mm(made, true) < 15


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
    assert error_mm(made, true) > 1
    assert error_mm(again, made @ turn.T + move) < 0.02  # places are found in single precision


def test_the_order_of_points_and_points_of_others_make_no_difference():
    true, rng = moving_tube(), rng_for(0, "order")
    start, points = true + 0.01, on_surface(true, 200, rng)
    wrong = np.concatenate([points, points + [0.1, 0, 0]], axis=1)
    chosen = np.repeat([[True, False]], 200, axis=1).repeat(FRAMES, axis=0)
    order = rng.permutation(400)
    made = fitted(start, wrong[:, order], chosen=chosen[:, order])
    np.testing.assert_allclose(made, fitted(start, points), atol=1e-5)


@pytest.mark.parametrize("share", [1.0, 0.9])
def test_lengths_come_back_to_what_they_are_when_worn(share):
    rest, none = tube(), np.zeros((1, 0, 3))
    settings = SETTINGS.replace(keep_m=1e-5, rounds=60)
    made = fitted(1.1 * rest[None], none, settings=settings, worn_statistics=statistics(share))[0]
    pairs, across = springs(FACES)
    first, second = pairs[~across].T
    ratio = np.linalg.norm(made[first] - made[second], axis=1)
    ratio /= np.linalg.norm(rest[first] - rest[second], axis=1)
    np.testing.assert_allclose(ratio, share, atol=0.02)


def test_vertices_that_start_well_are_kept():
    start = moving_tube()
    error = np.where(tube()[:, 2] > 0.3, 0.002, 0.5)
    points = on_surface(start, 400, rng_for(0, "keep")) + [0.0, 0.04, 0.0]
    settings = SETTINGS.replace(stretch=0, bend=0)
    made = fitted(start, points, settings=settings, worn_statistics=statistics(error_m=error))
    moved = np.linalg.norm(made - start, axis=-1).mean(0)
    assert moved[error < 0.01].max() < 0.03
    assert np.median(moved[error > 0.01]) > 0.03


def test_smoothing_takes_out_jitter_and_leaves_steady_motion():
    steady = tube() + 0.01 * np.arange(12)[:, None, None] * np.array([1.0, 0, 0])
    none = np.zeros((12, 0, 3))
    settings = SETTINGS.replace(stretch=0, bend=0, smooth=10.0)
    np.testing.assert_allclose(fitted(steady, none, settings=settings), steady, atol=1e-5)
    rough = steady + 0.01 * rng_for(0, "jitter").normal(size=steady.shape)
    made = fitted(rough, none, settings=settings)
    assert np.abs(np.diff(made, 2, axis=0)).mean() < 0.2 * np.abs(np.diff(rough, 2, axis=0)).mean()


def test_accelerations_that_garments_follow_are_those_of_the_proposal():
    bouncing = tube() + 0.02 * np.sin(2 * np.arange(12))[:, None, None] * np.array([0, 0, 1.0])
    settings = SETTINGS.replace(stretch=0, bend=0, smooth=10.0)
    none = np.zeros((12, 0, 3))
    made = fitted(bouncing, none, settings=settings, worn_statistics=statistics(follow=1.0))
    np.testing.assert_allclose(made, bouncing, atol=1e-5)
    flat = fitted(bouncing, none, settings=settings, worn_statistics=statistics(follow=0.0))
    assert np.ptp(flat[..., 2] - tube()[:, 2]) < 0.3 * np.ptp(bouncing[..., 2] - tube()[:, 2])


@pytest.mark.parametrize("frames", [1, 2, 6])
def test_the_solver_agrees_with_one_dense_system(frames):
    stiffness = EdgeSprings(tube(), FACES, SETTINGS, np.ones(1)).stiffness
    rng = rng_for(0, "dense")
    right, diagonal = rng.normal(size=(frames, VERTICES, 3)), rng.uniform(0.5, 2, VERTICES)
    solver = SmoothnessSolver(stiffness, diagonal, frames, 3.0)
    second = np.diff(np.eye(frames), 2, axis=0)
    bend = 3 * np.kron(second.T @ second, np.eye(VERTICES))
    matrix = np.kron(np.eye(frames), stiffness.toarray() + np.diag(diagonal)) + bend
    wanted = np.linalg.solve(matrix, right.reshape(-1, 3)).reshape(right.shape)
    np.testing.assert_allclose(solver(right), wanted, atol=1e-9)
    bent = (bend @ right.reshape(-1, 3)).reshape(right.shape)
    np.testing.assert_allclose(solver.acceleration_gradient(right), bent, atol=1e-9)


def test_springs_pull_as_the_gradient_of_their_energy_says():
    rng = rng_for(0, "springs")
    garment = tube()[None] + 0.01 * rng.normal(size=(2, VERTICES, 3))
    cloth = EdgeSprings(tube(), FACES, SETTINGS, np.full(1, 0.9))
    pairs, across = springs(FACES)
    weights = np.where(across, SETTINGS.bend, SETTINGS.stretch)
    rest = 0.9 * np.linalg.norm(tube()[pairs[:, 0]] - tube()[pairs[:, 1]], axis=1)

    def energy(points):
        away = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        return (weights * (away - rest) ** 2).sum() / 2

    for frame, made in enumerate(cloth.lengths(garment)):
        gradient = cloth.stiffness @ garment[frame] - made
        for vertex, axis in ((0, 0), (37, 1), (VERTICES - 1, 2)):
            step = np.zeros((VERTICES, 3))
            step[vertex, axis] = 1e-6
            slope = (energy(garment[frame] + step) - energy(garment[frame] - step)) / 2e-6
            assert gradient[vertex, axis] == pytest.approx(slope, abs=1e-7)


def test_point_pull_is_a_weighted_mean_of_offsets():
    rng = rng_for(0, "pull")
    garment = np.stack([tube(), tube() + 0.3])
    points = on_surface(garment, 15, rng) + 0.01 * rng.normal(size=(2, 15, 3))
    chosen = rng.random((2, 15)) < 0.7
    made = point_pull(garment, points, chosen, FACES, 0.02)
    for frame in range(2):
        top, total = np.zeros((VERTICES, 3)), np.zeros(VERTICES)
        corners = garment[frame][FACES]
        for point in points[frame][chosen[frame]]:
            # Nearest of many places on every face: a slow twin good to a fraction of a mm.
            u, v = np.meshgrid(np.linspace(0, 1, 31), np.linspace(0, 1, 31))
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
        assert np.abs(made[frame] - wanted).mean() < 1e-4
        assert np.abs(wanted).mean() > 3e-4


def test_a_point_at_the_reach_pulls_half_as_hard_as_a_close_one():
    """Two points over one corner, as far from it as the reach and twice as far."""
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points = np.array([[[0, 0, 0.02], [0, 0, 0.04]]])
    made = point_pull(triangle, points, np.ones((1, 2), bool), np.array([[0, 1, 2]]), 0.02)
    expected = (0.02 / 2 + 0.04 / 5) / (1 / 2 + 1 / 5)
    np.testing.assert_allclose(made, [[[0, 0, expected], [0, 0, 0], [0, 0, 0]]], atol=1e-6)


def test_frames_without_points_follow_the_others():
    true, rng = moving_tube(), rng_for(0, "gap")
    points = on_surface(true, 400, rng)
    chosen = np.ones(points.shape[:2], bool)
    chosen[2] = False
    settings = SETTINGS.replace(smooth=20.0)
    start = true + [0.0, 0.0, 0.03]
    made = fitted(start, points, chosen=chosen, settings=settings)
    assert error_mm(made[2], true[2]) < 0.7 * error_mm(start[2], true[2])
    nothing = fitted(true, points, chosen=np.zeros_like(chosen), settings=SETTINGS)
    assert error_mm(nothing, true) < 3


def test_vertices_inside_the_body_come_out_and_very_deep_ones_do_not():
    body = np.array([[[0.0, 0, 0]]])
    normal = np.array([[[0.0, 0, 1]]])
    garment = np.array([[[0.0, 0, 0.002], [0, 0, -0.03], [0, 0, -0.06], [0, 0, 0.2]]])
    nearest = np.zeros((1, 4), int)
    push = body_push(garment, body, normal, nearest, 0.003)
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


def test_vertices_on_bare_skin_go_to_the_hem_and_hidden_ones_stay():
    # A sleeve along x, seen up to x = .2; from there to .4 the arm is bare, beyond nothing is seen.
    grid = np.stack(np.meshgrid(np.arange(0, 0.41, 0.02), np.arange(0, 0.11, 0.02)), -1)
    cloud = np.concatenate([grid.reshape(-1, 2), np.zeros((grid[..., 0].size, 1))], axis=1)
    cloth = cloud[:, 0] < 0.205
    garment = np.array([[0.1, 0.05, 0.0], [0.21, 0.05, 0.0], [0.3, 0.04, 0.0], [0.9, 0.05, 0.0]])
    skin = SeenSkin(cloud[None], cloth[None], ~cloth[None])
    goals = skin.goals(garment[None])[0]
    assert np.isnan(goals[[0, 1, 3]]).all()
    np.testing.assert_allclose(goals[2], [0.2, 0.04, 0.0])
    # Without cloth in a frame nothing is known of where it ends.
    assert np.isnan(
        SeenSkin(cloud[None], ~cloth[None] & cloth[None], cloth[None]).goals(garment[None])
    ).all()


def test_a_garment_that_is_too_long_ends_where_skin_begins():
    rest = tube()
    low, high = rest[:, 2].min(), rest[:, 2].max()
    middle = (low + high) / 2
    rng = rng_for(0, "bare")
    cloud = on_surface(rest[None], 3000, rng)
    cloth = cloud[..., 2] > middle
    ends = [
        fitted(rest[None], cloud, chosen=cloth, bare=bare)[0][:, 2].min()
        for bare in (np.zeros_like(cloth), ~cloth)
    ]
    assert ends[1] > ends[0] + 0.2 * (middle - low)
