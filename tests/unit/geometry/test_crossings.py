from fractions import Fraction

import numpy as np
import pytest
import trimesh

from drapeline.geometry.crossings import Crossings, passes_through
from drapeline.geometry.mesh import edges, triangulate
from drapeline.seeding import rng_for
from toys.sheets import sheet


def slow_crossings(vertices, triangles):
    """The plain double loop over edges and faces, solving for the point of intersection."""
    pairs = edges(triangles)
    crossing = 0
    for i, j in pairs:
        for face in triangles:
            if {i, j} & set(face.tolist()):
                continue
            p, q, r = vertices[face]
            system = np.stack([vertices[i] - vertices[j], q - p, r - p], axis=1)
            if abs(np.linalg.det(system)) < 1e-12:
                continue
            t, u, v = np.linalg.solve(system, vertices[i] - p)
            if 0 < t < 1 and u >= 0 and v >= 0 and u + v <= 1:
                crossing += 1
                break
    return crossing


def found(vertices, faces):
    """Numbers of edges of each part that pass through itself, and through others."""
    return [x.tolist() for x in Crossings(vertices, faces).find(vertices)]


def test_crossings_agree_with_a_double_loop():
    rng = rng_for(3, "crossings")
    vertices = rng.normal(size=(24, 3)).astype(np.float32)
    triangles = np.array([rng.choice(24, 3, replace=False) for _ in range(30)])
    expected = slow_crossings(vertices, triangles)
    assert expected > 10
    assert found([vertices], [triangles]) == [[expected], [0]]


def test_a_ball_does_not_cross_itself_and_two_do():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    near, far = vertices + [0.5, 0.1, 0.03], vertices + [3, 0, 0]
    both = np.concatenate([faces, faces + len(vertices)])
    one = Crossings([np.concatenate([vertices, far])], [both])
    two = Crossings([vertices, far], [faces, faces])
    (count,), _ = one.find([np.concatenate([vertices, near])])
    own, other = two.find([vertices, near])
    assert own.tolist() == [0, 0]
    assert (other > 10).all()
    assert other.sum() == count
    # It is asked again, in another place.
    assert two.find([vertices, far])[1].tolist() == [0, 0]
    np.testing.assert_array_equal(two.edge_counts, 2 * [len(edges(faces))])


@pytest.mark.parametrize("scale", [1.0, 1e-3, 300.0])
def test_what_touches_passes_through_to_the_last_bit(scale):
    """An edge that ends a hair above a triangle does not, one that ends on it or below it does."""
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * np.float32(scale)
    tilted = corners + np.float32([[0, 0, 0.1], [0, 0, 0.3], [0, 0, 0.7]]) * np.float32(scale)
    for triangle in (corners, tilted):
        a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
        x, y = Fraction(float(triangle[1, 0])) / 4, Fraction(float(triangle[2, 1])) / 4
        level = a[2] + (b[2] - a[2]) / 4 + (c[2] - a[2]) / 4
        end = np.float32([float(x), float(y), float(level)])
        for steps in range(-3, 4):
            z = end[2]
            for _ in range(abs(steps)):
                z = np.nextafter(z, np.float32(np.inf if steps > 0 else -np.inf))
            segment = np.float32([[end[0], end[1], z], [end[0], end[1], 2 * scale]])
            expected = Fraction(float(z)) <= level
            assert passes_through(segment, triangle) == expected
            vertices = [np.concatenate([segment, segment[:1] + np.float32([0, 0, 3 * scale])])]
            vertices.append(triangle)
            count = found(vertices, [np.array([[0, 1, 2]]), np.array([[0, 1, 2]])])
            assert (count[1][0] > 0) == expected


def test_an_edge_in_the_plane_of_a_triangle_passes_through_nothing():
    triangle = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert not passes_through(np.float32([[-1, 0.2, 0], [1, 0.2, 0]]), triangle)
    assert passes_through(np.float32([[0.2, 0.2, 0], [0.2, 0.2, 1]]), triangle)
    flat = sheet(0.0, rows=4, edge_m=0.02)
    assert found([flat.vertices, flat.vertices], [flat.faces, flat.faces])[1] == [0, 0]


def test_a_quad_is_the_two_triangles_that_the_format_says():
    """A needle through the half that folds up misses the plane of the other."""
    quad = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]])
    assert triangulate(np.array([[0, 1, 2, 3]])).tolist() == [[0, 1, 2], [0, 2, 3]]
    needle = np.float32([[0.2, 0.8, 0.3], [0.2, 0.8, 0.9], [0.3, 0.9, 0.95]])
    below = needle - np.float32([0, 0, 0.75])
    faces = [np.array([[0, 1, 2, 3]]), np.array([[0, 1, 2]])]
    assert found([quad, needle], faces)[1][1] > 0
    assert found([quad, below], faces)[1] == [0, 0]
