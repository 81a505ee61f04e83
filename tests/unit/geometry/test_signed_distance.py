"""Signed distances, against a ball's and against libigl's own."""

import igl
import numpy as np
import trimesh

from drapeline.geometry.signed_distance import SignedDistance
from drapeline.seeding import rng_for


def test_distance_to_a_ball():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    points = np.array([[0.5, 0, 0], [0, 0, 0.31], [0.1, 0, 0]])
    distance, way = SignedDistance(mesh.vertices, mesh.faces).query(points)
    np.testing.assert_allclose(distance, [0.2, 0.01, -0.2], atol=2e-3)
    np.testing.assert_allclose(way[0], [1, 0, 0], atol=0.05)
    np.testing.assert_allclose(way[2], [1, 0, 0], atol=0.1)


def test_signs_are_those_of_libigl_beside_corners_and_edges():
    """A star has sharp edges in and out, where the nearest face alone would mislead."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    rng = rng_for(0, "star")
    vertices = mesh.vertices * rng.uniform(0.3, 1.5, (len(mesh.vertices), 1))
    solid = SignedDistance(vertices, mesh.faces)
    corners, normals = vertices[mesh.faces], solid.query(vertices)[1]
    points = np.concatenate(
        [
            rng.uniform(-1.5, 1.5, (2000, 3)),
            vertices + 0.01 * rng.standard_normal(vertices.shape),
            corners[:, :2].mean(axis=1) + 0.01 * rng.standard_normal((len(corners), 3)),
        ]
    )
    distance, way = solid.query(points)
    expected, _, nearest, _ = igl.signed_distance(
        points, vertices, mesh.faces, igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    )
    np.testing.assert_allclose(distance, expected, atol=1e-12)
    np.testing.assert_allclose(points - distance[:, None] * way, nearest, atol=1e-9)
    assert (distance < 0).any()
    # On the surface the way out is the pseudonormal.
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
