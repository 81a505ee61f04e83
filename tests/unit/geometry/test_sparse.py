"""Factors of symmetric systems."""

import numpy as np
import pytest
import scipy.sparse as sp

from drapeline.geometry.mesh import edge_graph
from drapeline.geometry.sparse import symmetric_factor


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
