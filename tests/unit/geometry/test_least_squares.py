"""Factors of symmetric systems."""

import numpy as np
import pytest
import scipy.sparse as sp

from drapeline.geometry.least_squares import LeastSquares, absolute_weights, symmetric_factor
from drapeline.geometry.mesh import edge_graph

RNG = np.random.default_rng(0)
SLOPES, VALUES = RNG.normal(size=(40, 5)), RNG.normal(size=40)


def test_a_step_solves_linear_equations():
    equations = LeastSquares(5)
    equations.add(SLOPES, -VALUES, 1.0)
    expected = np.linalg.lstsq(SLOPES, VALUES, rcond=None)[0]
    np.testing.assert_allclose(equations.step(0.0), expected, atol=1e-10)


def test_columns_go_to_their_places():
    whole, parts = LeastSquares(5), LeastSquares(5)
    weight = RNG.uniform(0.5, 2, 40)
    slopes = SLOPES.copy()
    slopes[:, 2] = 0
    whole.add(slopes, VALUES, weight)
    parts.add(SLOPES[:, [0, 1, 3, 4]], VALUES, weight, slice(0, 2), slice(3, 5))
    np.testing.assert_allclose(parts.matrix, whole.matrix)
    np.testing.assert_allclose(parts.right, whole.right)


def test_priors_are_squares_of_the_unknowns():
    with_prior, with_rows = LeastSquares(5), LeastSquares(5)
    at = RNG.normal(size=3)
    for equations in (with_prior, with_rows):
        equations.add(SLOPES, VALUES, 1.0)
    with_prior.add_prior(slice(1, 4), at, 4.0)
    with_rows.add(2 * np.eye(3), 2 * at, 1.0, slice(1, 4))
    np.testing.assert_allclose(with_prior.step(), with_rows.step())


def test_weighted_squares_settle_at_the_median():
    values, at = np.array([0.0, 1, 2, 3, 100]), 50.0
    for _ in range(200):
        equations = LeastSquares(1)
        residual = at - values
        equations.add(np.ones((5, 1)), residual, absolute_weights(residual, 1e-6))
        at += equations.step(0.0)[0]
    assert at == pytest.approx(2, abs=1e-3)


def test_a_factor_solves_as_a_dense_solver_does():
    ring = np.column_stack([np.arange(50), (np.arange(50) + 1) % 50])
    graph = edge_graph(np.sort(ring, axis=1), 50)
    system = sp.diags(np.linspace(2.5, 4, 50)) - graph
    wanted = np.random.default_rng(0).normal(size=(50, 3))
    found = symmetric_factor(system).solve(wanted)
    np.testing.assert_allclose(found, np.linalg.solve(system.toarray(), wanted), atol=1e-12)


def test_a_singular_system_is_refused():
    with pytest.raises(RuntimeError, match="singular"):
        symmetric_factor(sp.csr_matrix((3, 3)))
