"""Chebyshev graph convolution on node-major tensors (N, B, F), after CLOTH3D equation 2.

A fixed sparse matrix is applied with `embedding_bag`: one pass over the rows, B * F numbers at a
time, and no message tensor; its backward pass is the same call on the transposed matrix.
"""

import math

import numpy as np
import torch
import torch.nn.functional as F
from scipy import sparse
from torch import nn


class SparseMatrix(nn.Module):
    """A constant (M, N) matrix that maps (N, ...) tensors to (M, ...) ones, differentiably."""

    def __init__(self, matrix: sparse.spmatrix) -> None:
        super().__init__()
        self.shape = matrix.shape
        for name, half in (("forward", matrix.tocsr()), ("transposed", matrix.T.tocsr())):
            half.sort_indices()
            self._hold(f"{name}_index", torch.from_numpy(half.indices.astype(np.int64)))
            self._hold(f"{name}_start", torch.from_numpy(half.indptr.astype(np.int64)))
            self._hold(f"{name}_value", torch.from_numpy(half.data.astype(np.float64)))

    def _hold(self, name: str, tensor: torch.Tensor) -> None:
        # Rebuilt from the mesh whenever a network is, so no part of a checkpoint.
        if tensor.is_floating_point():
            tensor = tensor.to(torch.get_default_dtype())
        self.register_buffer(name, tensor, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, ...) -> (M, ...)."""
        return _Product.apply(x, self, "forward")

    def product(self, x: torch.Tensor, way: str) -> torch.Tensor:
        """The matrix ("forward") or its transpose ("transposed") times `x`, without a gradient."""
        index, start, value = (getattr(self, f"{way}_{part}") for part in _PARTS)
        rows = x.reshape(len(x), -1)
        out = F.embedding_bag(
            index,
            rows,
            start,
            mode="sum",
            per_sample_weights=value.to(rows.dtype),
            include_last_offset=True,
        )
        return out.view(-1, *x.shape[1:])


_PARTS = ("index", "start", "value")
_TRANSPOSE_OF = {"forward": "transposed", "transposed": "forward"}


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x: torch.Tensor, matrix: SparseMatrix, way: str) -> torch.Tensor:
        ctx.matrix, ctx.way = matrix, way
        return matrix.product(x.detach(), way)

    @staticmethod
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        return _Product.apply(gradient, ctx.matrix, _TRANSPOSE_OF[ctx.way]), None, None


def polynomials(laplacian: sparse.spmatrix, order: int) -> list[sparse.csr_matrix]:
    """Chebyshev polynomials T_0 ... T_order of a scaled Laplacian, as sparse matrices."""
    terms = [sparse.identity(laplacian.shape[0], format="csr"), laplacian.tocsr()]
    for _ in range(order - 1):
        terms.append((2 * laplacian @ terms[-1] - terms[-2]).tocsr())
    return terms[: order + 1]


class ChebConv(nn.Module):
    """y = sum_k T_k(L) x W_k + b for k = 0 ... order (CLOTH3D equation 2).

    The graph is an argument, so the same weights serve every topology. L is applied to whichever
    of x and x W is narrower; both orders give the same y.

    Args:
        inputs, outputs: features per node.
        order: K of the paper; 1 means two terms.
        rng: source of the initial weights.
    """

    def __init__(self, inputs: int, outputs: int, order: int, rng: torch.Generator) -> None:
        super().__init__()
        self.weight = nn.Parameter(drawn((order + 1, inputs, outputs), inputs * (order + 1), rng))
        self.bias = nn.Parameter(torch.zeros(outputs))

    def forward(self, x: torch.Tensor, laplacian: SparseMatrix) -> torch.Tensor:
        """(N, B, inputs) -> (N, B, outputs)."""
        return self.rows(x, laplacian).view(*x.shape[:2], -1)

    def rows(self, x: torch.Tensor, laplacian: SparseMatrix) -> torch.Tensor:
        """(N, B, inputs) -> (N * B, outputs), no view of anything: safe to change in place."""
        if self.weight.shape[1] <= self.weight.shape[2]:
            return self._recurrence(x, laplacian)
        return self._clenshaw(x, laplacian)

    def _recurrence(self, x: torch.Tensor, laplacian: SparseMatrix) -> torch.Tensor:
        before, term = x, laplacian(x)
        out = torch.addmm(self.bias, x.flatten(0, 1), self.weight[0])
        # In place, which autocast does not reach, so that no sum is held twice.
        out.addmm_(term.flatten(0, 1).to(out.dtype), self.weight[1].to(out.dtype))
        for weight in self.weight[2:]:
            before, term = term, 2 * laplacian(term) - before
            out.addmm_(term.flatten(0, 1).to(out.dtype), weight.to(out.dtype))
        return out

    def _clenshaw(self, x: torch.Tensor, laplacian: SparseMatrix) -> torch.Tensor:
        rows, shape = x.flatten(0, 1), (*x.shape[:2], -1)
        after, term = None, (rows @ self.weight[-1]).view(shape)
        for weight in self.weight[1:-1].flip(0):
            step = (rows @ weight).view(shape) + 2 * laplacian(term)
            after, term = term, step if after is None else step - after
        out = torch.addmm(self.bias, rows, self.weight[0])
        out.add_(laplacian(term).flatten(0, 1))
        return out if after is None else out.sub_(after.flatten(0, 1))


class UnpoolConv(nn.Module):
    """Copy unpooling followed by a Chebyshev convolution, in one product.

    With U the copying matrix, T_k(L) U (x W_k) = T_k(L) (U x) W_k: the dense products are done on
    the coarse nodes, a quarter of the fine ones, and T_k(L) U is a constant matrix.
    """

    def __init__(self, inputs: int, outputs: int, order: int, rng: torch.Generator) -> None:
        super().__init__()
        self.weight = nn.Parameter(drawn((order + 1, inputs, outputs), inputs * (order + 1), rng))
        self.bias = nn.Parameter(torch.zeros(outputs))

    def forward(self, x: torch.Tensor, unpool: SparseMatrix) -> torch.Tensor:
        """(n, B, inputs) on coarse nodes -> (N, B, outputs) on fine ones."""
        return self.rows(x, unpool).view(-1, x.shape[1], self.bias.shape[0])

    def rows(self, x: torch.Tensor, unpool: SparseMatrix) -> torch.Tensor:
        """(n, B, inputs) -> (N * B, outputs), no view of anything: safe to change in place.

        Args:
            unpool: (N, (order + 1) * n) matrices T_k(L) U side by side, `graph.unpool_matrix`.
        """
        wide = torch.matmul(x.flatten(0, 1), self.weight)  # (order + 1, n * B, outputs)
        return unpool(wide.view(-1, x.shape[1], wide.shape[-1])).flatten(0, 1) + self.bias


def drawn(shape: tuple[int, ...], inputs: int, rng: torch.Generator) -> torch.Tensor:
    """Uniform initial weights that keep the variance through a ReLU (He et al.)."""
    bound = math.sqrt(6 / inputs)
    return (2 * torch.rand(shape, generator=rng) - 1) * bound


def linear(inputs: int, outputs: int, rng: torch.Generator) -> nn.Linear:
    """A fully connected layer whose initial weights come from `rng` alone."""
    layer = nn.utils.skip_init(nn.Linear, inputs, outputs)
    with torch.no_grad():
        layer.weight.copy_(drawn((outputs, inputs), inputs, rng))
        layer.bias.zero_()
    return layer
