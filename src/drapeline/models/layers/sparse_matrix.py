"""A constant sparse matrix that gradients flow through.

It is applied with `embedding_bag`: one pass over the rows, all features of a row at a time, and no
message tensor; the backward pass is the same call on the transposed matrix.
"""

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
            values = torch.from_numpy(half.data.astype(np.float64))
            tensors = {
                "index": torch.from_numpy(half.indices.astype(np.int64)),
                "start": torch.from_numpy(half.indptr.astype(np.int64)),
                "value": values.to(torch.get_default_dtype()),
            }
            for part, tensor in tensors.items():
                # Rebuilt from the mesh whenever a network is, so not part of a checkpoint.
                self.register_buffer(f"{name}_{part}", tensor, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, ...) -> (M, ...)."""
        return _Product.apply(x, self, "forward")

    def product(self, x: torch.Tensor, direction: str) -> torch.Tensor:
        """The matrix ("forward") or its transpose ("transposed") times `x`, without a gradient."""
        index, start, value = (
            getattr(self, f"{direction}_{part}") for part in ("index", "start", "value")
        )
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


_TRANSPOSE_OF = {"forward": "transposed", "transposed": "forward"}


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x: torch.Tensor, matrix: SparseMatrix, direction: str) -> torch.Tensor:
        ctx.matrix, ctx.direction = matrix, direction
        return matrix.product(x.detach(), direction)

    @staticmethod
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        return _Product.apply(gradient, ctx.matrix, _TRANSPOSE_OF[ctx.direction]), None, None
