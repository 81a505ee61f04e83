import numpy as np
import pytest
import trimesh

from drapeline.geometry.mesh import edges
from drapeline.geometry.moving_surface import SelfCrossings


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
    return crossing / len(pairs)


def test_crossings_agree_with_a_double_loop():
    rng = np.random.default_rng(3)
    vertices = rng.normal(size=(24, 3))
    triangles = np.array([rng.choice(24, 3, replace=False) for _ in range(30)])
    expected = slow_crossings(vertices, triangles)
    assert expected > 0.1
    assert SelfCrossings(vertices, triangles).share(vertices) == pytest.approx(expected)


def test_a_ball_does_not_cross_itself_and_two_do():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    assert SelfCrossings(vertices, faces).share(vertices) == 0
    both = np.concatenate([vertices, vertices + [0.5, 0.1, 0.03]])
    apart = np.concatenate([vertices, vertices + [3, 0, 0]])
    triangles = np.concatenate([faces, faces + len(vertices)])
    two = SelfCrossings(apart, triangles)
    assert two.share(apart) == 0
    assert two.share(both) == SelfCrossings(both, triangles).share(both) > 0.01
    assert two.share(apart) == 0
