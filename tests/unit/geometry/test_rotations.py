import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.geometry.rotations import nearest_rotations
from drapeline.seeding import rng_for


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_rotation_that_was_stretched_is_found(size):
    """A rotation times any symmetric positive matrix."""
    rng = rng_for(1, "rotations")
    turns = Rotation.random(50, random_state=1).as_matrix()
    axes = Rotation.random(50, random_state=2).as_matrix()
    stretch = axes * rng.uniform(0.2, 3, (50, 1, 3)) @ axes.transpose(0, 2, 1)
    np.testing.assert_allclose(nearest_rotations(size * turns @ stretch), turns, atol=1e-9)


def test_no_rotation_is_nearer():
    """Those of matrices that mirror as well."""
    rng = rng_for(2, "rotations")
    matrices = rng.normal(size=(40, 3, 3))
    found = nearest_rotations(matrices)
    assert (np.linalg.det(matrices) < 0).any()
    np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-12)
    np.testing.assert_allclose(
        found @ found.transpose(0, 2, 1), np.tile(np.eye(3), (40, 1, 1)), atol=1e-12
    )
    traces = np.einsum("nij,nij->n", found, matrices)
    for others in (0.02, 3.0):
        turned = found @ Rotation.from_rotvec(others * rng.normal(size=(40, 3))).as_matrix()
        assert (np.einsum("nij,nij->n", turned, matrices) < traces).all()


def test_points_in_a_plane_tell_a_rotation():
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    points = np.column_stack([rng_for(3, "points").normal(size=(9, 2)), np.zeros(9)])
    np.testing.assert_allclose(
        nearest_rotations((points @ turn.T).T[None] @ points)[0], turn, atol=1e-9
    )


def test_no_matrices_have_no_rotations():
    assert nearest_rotations(np.zeros((0, 3, 3))).shape == (0, 3, 3)
