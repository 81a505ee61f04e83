"""Skinning weights of garments against slow twins and simple truths."""

import numpy as np
import pytest

from drapeline.bodies.weight_transfer import interpolated_weights, nearest_points, nearest_weights
from drapeline.geometry.mesh import vertex_normals


def lattice(count, seed, step=16):
    return np.random.default_rng(seed).integers(-step, step + 1, (count, 3)) / step


def by_sorting(points, places, count):
    squared = ((places[:, None] - points) ** 2).sum(axis=-1)
    order = np.argsort(squared, axis=1, kind="stable")[:, :count]
    return np.take_along_axis(squared, order, axis=1), order


@pytest.mark.parametrize("count", [1, 2, 7, 150, 400])
@pytest.mark.parametrize("spread", [0.1, 1, 30])
def test_the_nearest_are_those_of_a_sort(count, spread):
    points, places = lattice(400, 0), lattice(50, 1) * spread
    points[:250] /= 8  # crowded in the middle
    squared, index = nearest_points(points, places, count)
    expected, order = by_sorting(points, places, count)
    np.testing.assert_array_equal(np.sort(index, axis=1), np.sort(order, axis=1))
    np.testing.assert_array_equal(np.sort(squared, axis=1), expected)
    exact = ((places[:, None] - points[index]) ** 2).sum(axis=-1)
    np.testing.assert_array_equal(squared, exact)


def test_flat_and_coinciding_points_and_no_places():
    flat = lattice(60, 2) * [1, 0, 0]
    for points in (flat, np.ones((9, 3)), flat[:1]):
        _, index = nearest_points(points, flat[:5], len(points))
        assert (np.sort(index, axis=1) == np.arange(len(points))).all()
    squared, index = nearest_points(flat, np.zeros((0, 3)), 4)
    assert squared.shape == index.shape == (0, 4)


FACES = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])


@pytest.fixture(scope="module")
def cloth():
    return np.random.default_rng(1).normal(0, 0.2, (6, 3))  # the last one belongs to no face


@pytest.fixture(scope="module")
def body():
    rng = np.random.default_rng(2)
    weights = rng.random((50, 24)) ** 4
    return rng.normal(0, 0.2, (50, 3)), weights / weights.sum(axis=1, keepdims=True)


def brute_force(garment, body, weights, neighbours, power):
    out = []
    for point in garment:
        distance = np.linalg.norm(body - point, axis=1)
        near = np.argsort(distance)[:neighbours]
        share = 1 / distance[near] ** power
        out.append(share @ weights[near] / share.sum())
    return np.array(out)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("neighbours", [1, 7, 50, 256])
def test_weights_are_those_of_a_loop_over_points(cloth, body, neighbours, power):
    found = interpolated_weights(cloth, FACES, *body, neighbours, 0, power=power)
    np.testing.assert_allclose(found, brute_force(cloth, *body, neighbours, power), atol=1e-4)
    assert found.dtype == np.float32


def test_smoothing_is_as_many_dense_passes(cloth, body):
    rough = interpolated_weights(cloth, FACES, *body, 5, 0).astype(np.float64)
    adjacency = np.zeros((6, 6))
    for face in FACES:
        for a, b in zip(face, np.roll(face, -1), strict=True):
            adjacency[a, b] = adjacency[b, a] = 1
    expected = rough
    for _ in range(3):
        mean = adjacency[:5] @ expected / adjacency[:5].sum(axis=1, keepdims=True)
        expected = np.concatenate([0.9 * expected[:5] + 0.1 * mean, expected[5:]])
    found = interpolated_weights(cloth, FACES, *body, 5, passes=3)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_rows_sum_to_one(cloth, body):
    found = interpolated_weights(cloth, FACES, *body)
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-5)
    assert (found >= 0).all()


def test_a_garment_vertex_on_a_body_vertex_takes_after_it_alone(cloth, body):
    vertices, weights = body
    on = np.concatenate([vertices[17:18], cloth[1:]])
    found = interpolated_weights(on, FACES, vertices, weights, 8, 0)
    np.testing.assert_allclose(found[0], weights[17], atol=1e-6)


def test_the_released_code_gives_a_coincident_vertex_no_weight(cloth, body):
    vertices, weights = body
    on = np.concatenate([vertices[17:18], cloth[1:]])
    found = interpolated_weights(on, FACES, vertices, weights, 8, 0, coincident="released")
    others = np.delete(np.arange(50), 17)
    expected = brute_force(on[:1], vertices[others], weights[others], 7, 1)
    np.testing.assert_allclose(found[:1], expected, atol=1e-4)
    alone = interpolated_weights(on, FACES, vertices, weights, 1, 0, coincident="released")
    np.testing.assert_allclose(alone[0], weights[17], atol=1e-6)


def test_body_vertices_that_coincide_share(body):
    vertices, weights = body
    vertices = vertices.copy()
    vertices[3] = vertices[4]
    found = interpolated_weights(vertices[3:4], np.zeros((0, 3), int), vertices, weights, 8, 0)
    np.testing.assert_allclose(found[0], weights[3:5].mean(axis=0), atol=1e-6)


def test_the_order_of_the_body_and_rigid_motions_do_not_matter(cloth, body):
    vertices, weights = body
    order = np.random.default_rng(0).permutation(50)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    expected = interpolated_weights(cloth, FACES, vertices, weights, 9)
    found = interpolated_weights(
        cloth @ turn + 0.3, FACES, vertices[order] @ turn + 0.3, weights[order], 9
    )
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_more_neighbours_make_less_of_a_cliff_between_two_legs():
    """Figure 7: a strip of cloth across the gap between two legs."""
    heights = np.linspace(0, 1, 40)
    legs = np.concatenate(
        [np.column_stack([np.full(40, x), np.zeros(40), heights]) for x in (-0.1, 0.1)]
    )
    weights = np.zeros((80, 24))
    weights[:40, 1] = weights[40:, 2] = 1
    x = np.linspace(-0.1, 0.1, 21)
    strip = np.column_stack([x, np.full(21, 0.05), np.full(21, 0.5)])
    none = np.zeros((0, 3), dtype=int)

    def cliff(neighbours):
        found = interpolated_weights(strip, none, legs, weights, neighbours, 0)
        return np.abs(np.diff(found[:, 2])).max()

    assert cliff(1) == pytest.approx(1)
    assert cliff(80) < 0.1


@pytest.fixture(scope="module")
def shell(toy_body):
    """A shell two centimetres outside of the toy's torso and thighs: vertices, faces, mask."""
    rest = toy_body.v_template.astype(np.float64)
    mask = (np.abs(rest[:, 1] + 0.25) < 0.3) & (np.abs(rest[:, 0]) < 0.3)
    vertices = rest + 0.02 * vertex_normals(rest, toy_body.faces)
    return vertices, toy_body.faces[mask[toy_body.faces].all(1)], mask


def test_nearest_weights_are_smooth_sums_of_the_body_beneath(toy_body, shell):
    vertices, faces, _ = shell
    found = nearest_weights(vertices, faces, toy_body.v_template, toy_body.faces, toy_body.weights)
    used = np.unique(faces)
    np.testing.assert_allclose(found[used].sum(axis=1), 1, atol=1e-5)
    assert found.min() >= 0
    assert not np.delete(found, used, axis=0).any()
    beneath = toy_body.weights[used]
    assert np.abs(found[used] - beneath).mean() < 0.05
    assert np.ptp(found[used], axis=0).max() <= np.ptp(beneath, axis=0).max() + 1e-6


def test_cloth_between_two_walls_takes_after_the_one_it_faces():
    """It is nearer to the left wall, which looks the other way."""
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(6), indexing="ij"), -1).reshape(-1, 2)
    corner = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 6, corner + 7], axis=1),
            np.stack([corner, corner + 7, corner + 1], axis=1),
        ]
    )

    def wall(x):
        return np.column_stack([np.full(36, x), 0.02 * grid])

    body = np.concatenate([wall(0.0), wall(0.05)])
    body_faces = np.concatenate([faces[:, ::-1], faces + 36])  # one looks left, the other right
    weights = np.repeat(np.eye(2), 36, axis=0)
    found = nearest_weights(wall(0.01), faces, body, body_faces, weights)
    np.testing.assert_allclose(found, np.tile([0, 1], (36, 1)), atol=0.3)
    turned = nearest_weights(wall(0.01), faces[:, ::-1], body, body_faces, weights)
    assert turned[:, 0].min() > 0.9
