"""Laplacians and pooling tables against what they must be."""

import numpy as np
import pytest
import torch

from drapeline.geometry.mesh import edges
from drapeline.models.layers.graphs import ClusterMax, MeshGraph, scaled_laplacian
from toys.gcvae import COUNTS, VERTICES, hierarchy, tube_faces


def test_the_scaled_laplacian_has_its_spectrum_in_one_to_minus_one():
    values = np.linalg.eigvalsh(scaled_laplacian(edges(tube_faces(False)), VERTICES).toarray())
    np.testing.assert_allclose([values[0], values[-1]], [-1, 1], atol=1e-5)


def test_a_path_of_two_nodes_is_known_exactly():
    # L = [[1, -1], [-1, 1]] has the eigenvalues 0 and 2.
    laplacian = scaled_laplacian(np.array([[0, 1]]), 2).toarray()
    np.testing.assert_allclose(laplacian, [[0, -1], [-1, 0]], atol=1e-12)


def test_a_node_without_edges_is_left_to_itself():
    laplacian = scaled_laplacian(np.array([[0, 1]]), 3).toarray()
    np.testing.assert_allclose(laplacian[2], [0, 0, 0], atol=1e-12)


def test_max_pooling_and_its_gradient_are_the_slow_twins():
    rng = np.random.default_rng(0)
    parents = np.concatenate([np.arange(7), rng.integers(0, 7, 40)])
    x = torch.from_numpy(rng.standard_normal((47, 3, 2))).requires_grad_(True)
    pooled = ClusterMax(parents, 7)(x)
    slow = torch.stack([x[parents == node].amax(0) for node in range(7)])
    torch.testing.assert_close(pooled, slow)
    weigh = torch.from_numpy(rng.standard_normal(pooled.shape))
    for result in (pooled, slow):
        (gradient,) = torch.autograd.grad((result * weigh).sum(), x)
        torch.testing.assert_close(gradient, x.grad if x.grad is not None else gradient)
        x.grad = gradient
    assert torch.autograd.gradcheck(ClusterMax(parents, 7), x)


def test_a_coarse_node_without_children_is_refused():
    with pytest.raises(ValueError, match="coarse node 1"):
        ClusterMax(np.array([0, 0, 2]), 3)


def test_a_graph_has_an_operator_per_level():
    all_edges, parents = hierarchy(tube_faces(False))
    graph = MeshGraph(all_edges, parents, 2)
    assert graph.counts == list(COUNTS)
    x = torch.rand(VERTICES, 2, 3)
    for level, count in enumerate(COUNTS[:-1]):
        assert graph.laplacians[level](x).shape == (count, 2, 3)
        x = graph.pools[level](x)
        assert graph.unpools[level](x.repeat(3, 1, 1)).shape == (count, 2, 3)
