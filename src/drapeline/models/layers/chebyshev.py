"""Chebyshev graph convolution on node-major tensors (N, B, F), after CLOTH3D equation 2."""

import torch
from scipy import sparse
from torch import nn

from drapeline.models.layers.linear import he_uniform
from drapeline.models.layers.sparse_matrix import SparseMatrix


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
        self.weight = nn.Parameter(
            he_uniform((order + 1, inputs, outputs), inputs * (order + 1), rng)
        )
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
        self.weight = nn.Parameter(
            he_uniform((order + 1, inputs, outputs), inputs * (order + 1), rng)
        )
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
