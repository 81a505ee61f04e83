"""The convolution against a dense oracle and against torch_geometric's own."""

import numpy as np
import pytest
import torch
from scipy import sparse

from drapeline.geometry.mesh import edges
from drapeline.models.layers.graphs import (
    ChebConv,
    SparseMatrix,
    UnpoolConv,
    copy_matrix,
    polynomials,
    scaled_laplacian,
    unpool_matrix,
)
from toys.gcvae import VERTICES, tube_faces

pytestmark = pytest.mark.usefixtures("double")


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize(("inputs", "outputs"), [(3, 5), (5, 3), (4, 4)])
def test_equals_the_sum_of_dense_chebyshev_polynomials(laplacian, order, inputs, outputs):
    conv = ChebConv(inputs, outputs, order, rng())
    torch.nn.init.normal_(conv.bias, generator=rng(1))
    x = torch.randn(VERTICES, 2, inputs, generator=rng(2))
    dense = laplacian.toarray()
    terms = [np.eye(VERTICES), dense]
    for _ in range(order - 1):
        terms.append(2 * dense @ terms[-1] - terms[-2])
    y = conv.bias + sum(
        torch.einsum("nm,mbi,io->nbo", torch.from_numpy(t), x, w)
        for t, w in zip(terms, conv.weight, strict=False)
    )
    torch.testing.assert_close(conv(x, SparseMatrix(laplacian)), y)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("inputs", "outputs"), [(3, 6), (6, 3)])
def test_equals_torch_geometric_in_values_and_gradients(order, inputs, outputs):
    geometric = pytest.importorskip("torch_geometric.nn")
    pairs = edges(tube_faces(False))
    plain = scaled_laplacian(pairs, VERTICES)
    # torch_geometric is told lambda_max; ours is 2 / (1 + the diagonal of 2 L / lambda_max - I).
    lambda_max = 2 / (1 + plain.diagonal()[0])
    oracle = geometric.ChebConv(inputs, outputs, K=order + 1, normalization="sym").double()
    conv = ChebConv(inputs, outputs, order, rng())
    with torch.no_grad():
        for lin, weight in zip(oracle.lins, conv.weight, strict=True):
            lin.weight.copy_(weight.T)
        oracle.bias.copy_(conv.bias.normal_(generator=rng(1)))
    both_ways = torch.from_numpy(np.concatenate([pairs, pairs[:, ::-1]]).T.astype(np.int64))
    x = torch.randn(VERTICES, 2, inputs, generator=rng(2), requires_grad=True)
    twin = x.detach().transpose(0, 1).clone().requires_grad_(True)
    ours = conv(x, SparseMatrix(plain))
    theirs = oracle(twin, both_ways, lambda_max=torch.tensor(lambda_max)).transpose(0, 1)
    torch.testing.assert_close(ours, theirs)
    weigh = torch.randn(ours.shape, generator=rng(3))
    (ours * weigh).sum().backward()
    (theirs * weigh).sum().backward()
    torch.testing.assert_close(x.grad, twin.grad.transpose(0, 1))
    for lin, gradient in zip(oracle.lins, conv.weight.grad, strict=True):
        torch.testing.assert_close(gradient.T, lin.weight.grad)
    torch.testing.assert_close(conv.bias.grad, oracle.bias.grad)


@pytest.mark.parametrize(("inputs", "outputs", "order"), [(2, 3, 1), (3, 2, 1), (3, 2, 2)])
def test_gradients_by_finite_differences(inputs, outputs, order):
    pairs = np.array([[0, 1], [1, 2], [2, 3], [0, 3], [1, 3]])
    matrix = SparseMatrix(scaled_laplacian(pairs, 4))
    conv = ChebConv(inputs, outputs, order, rng())
    x = torch.randn(4, 2, inputs, generator=rng(1), requires_grad=True)
    assert torch.autograd.gradcheck(lambda x, w: _with(conv, w)(x, matrix), (x, conv.weight))


def _with(conv, weight):
    return lambda *args: torch.func.functional_call(conv, {"weight": weight}, args)


@pytest.mark.parametrize("order", [1, 2])
def test_unpool_convolution_is_copying_followed_by_a_convolution(laplacian, order):
    parents = np.arange(VERTICES) // 4
    coarse = VERTICES // 4
    fused, conv = UnpoolConv(6, 3, order, rng()), ChebConv(6, 3, order, rng())
    with torch.no_grad():
        conv.bias.copy_(fused.bias.normal_(generator=rng(1)))
    x = torch.randn(coarse, 2, 6, generator=rng(2))
    y = fused(x, SparseMatrix(unpool_matrix(laplacian, parents, coarse, order)))
    copied = SparseMatrix(copy_matrix(parents, coarse))(x)
    torch.testing.assert_close(copied, x[parents])
    torch.testing.assert_close(y, conv(copied, SparseMatrix(laplacian)))


def test_polynomials_of_a_diagonal_are_cosines():
    angle = np.linspace(0, 3, 5)
    terms = polynomials(sparse.diags(np.cos(angle)).tocsr(), 4)
    for k, term in enumerate(terms):
        np.testing.assert_allclose(term.diagonal(), np.cos(k * angle), atol=1e-12)


def test_node_order_does_not_matter(laplacian):
    order = np.random.default_rng(0).permutation(VERTICES)
    conv = ChebConv(3, 5, 1, rng())
    x = torch.randn(VERTICES, 2, 3, generator=rng(1))
    turned = SparseMatrix(laplacian[order][:, order])
    torch.testing.assert_close(conv(x[order], turned), conv(x, SparseMatrix(laplacian))[order])
