"""What a mesh hierarchy is to a network: scaled Laplacians, pooling and unpooling tables."""

from collections.abc import Sequence

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import eigsh
from torch import nn

from drapeline.geometry.mesh import edge_graph
from drapeline.models.layers.chebyshev import polynomials
from drapeline.models.layers.sparse_matrix import SparseMatrix

_DENSE_NODES = 64


def scaled_laplacian(edges: np.ndarray, count: int) -> sparse.csr_matrix:
    """2 L / lambda_max - I of the normalised Laplacian L = I - D^-1/2 A D^-1/2 (CLOTH3D 4.2).

    Args:
        edges: (E, 2) undirected edges, each once.
        count: number of nodes; one without edges keeps a 1 on the diagonal of L.
    """
    adjacency = edge_graph(edges, count)
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    scale = sparse.diags(1 / np.sqrt(np.maximum(degree, 1)))
    identity = sparse.identity(count, format="csr")
    laplacian = identity - scale @ adjacency @ scale
    return (2 / _largest_eigenvalue(laplacian) * laplacian - identity).tocsr()


def _largest_eigenvalue(laplacian: sparse.csr_matrix) -> float:
    if laplacian.shape[0] <= _DENSE_NODES:
        return float(np.linalg.eigvalsh(laplacian.toarray())[-1])
    start = np.cos(np.arange(laplacian.shape[0]))  # any start but a random one
    return float(eigsh(laplacian, k=1, which="LA", v0=start, tol=1e-6)[0][0])


def copy_matrix(parents: np.ndarray, coarse: int) -> sparse.csr_matrix:
    """(N, n) matrix that gives every fine node its parent's features."""
    count = len(parents)
    return sparse.csr_matrix((np.ones(count), (np.arange(count), parents)), shape=(count, coarse))


class ClusterMax(nn.Module):
    """Max pooling over the children of each coarse node.

    Children that tie all receive the gradient: after a ReLU only zeros tie, and those pass none on.
    """

    def __init__(self, parents: np.ndarray, coarse: int) -> None:
        super().__init__()
        order = np.argsort(parents, kind="stable")
        sizes = np.bincount(parents, minlength=coarse)
        if (sizes == 0).any():
            raise ValueError(f"coarse node {int(np.argmin(sizes))} has no children")
        start = np.cumsum(sizes) - sizes
        # Largest clusters first: slot s then holds a child of the first so many clusters.
        by_size = np.argsort(-sizes, kind="stable")
        self.slots = int(sizes.max())
        for slot in range(self.slots):
            there = by_size[sizes[by_size] > slot]
            table = torch.from_numpy(order[start[there] + slot])
            self.register_buffer(f"slot_{slot}", table, persistent=False)
        for name, table in (("place", np.argsort(by_size)), ("parents", parents)):
            table = torch.from_numpy(np.asarray(table, dtype=np.int64))
            self.register_buffer(name, table, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, B, F) -> (n, B, F)."""
        return _Max.apply(x, self)


class _Max(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x: torch.Tensor, pool: ClusterMax) -> torch.Tensor:
        out = x.index_select(0, pool.slot_0)
        for slot in range(1, pool.slots):
            children = getattr(pool, f"slot_{slot}")
            part = out[: len(children)]
            torch.maximum(part, x.index_select(0, children), out=part)
        out = out.index_select(0, pool.place)
        ctx.pool = pool
        ctx.save_for_backward(x, out)
        return out

    @staticmethod
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, None]:
        x, out = ctx.saved_tensors
        wins = x == out.index_select(0, ctx.pool.parents)
        return gradient.index_select(0, ctx.pool.parents).mul_(wins), None


class MeshGraph(nn.Module):
    """One topology's hierarchy as constant operators; level 0 is the finest.

    Args:
        edges: (E_l, 2) of every level.
        parents: (n_l,) the node of level l + 1 that each node of level l belongs to.
        order: of the Chebyshev polynomials.
        places: (n_0, P) constants of the finest nodes; a coarser node has its children's mean.
    """

    def __init__(
        self,
        edges: Sequence[np.ndarray],
        parents: Sequence[np.ndarray],
        order: int,
        places: np.ndarray,
    ) -> None:
        super().__init__()
        self.counts = [len(p) for p in parents] + [int(parents[-1].max()) + 1]
        laplacians = [scaled_laplacian(e, n) for e, n in zip(edges, self.counts, strict=True)]
        self.laplacians = nn.ModuleList(map(SparseMatrix, laplacians))
        self.pools = nn.ModuleList(map(ClusterMax, parents, self.counts[1:]))
        self.unpools = nn.ModuleList(
            SparseMatrix(unpool_matrix(laplacian, p, n, order))
            for laplacian, p, n in zip(laplacians[:-1], parents, self.counts[1:], strict=True)
        )
        for level in range(len(self.counts)):
            table = torch.from_numpy(np.asarray(places, dtype=np.float32))
            self.register_buffer(f"places_{level}", table, persistent=False)
            if level < len(parents):
                sums = copy_matrix(parents[level], self.counts[level + 1]).T @ places
                places = sums / np.bincount(parents[level])[:, None]

    def places(self, level: int) -> torch.Tensor:
        """(n_level, P)."""
        return getattr(self, f"places_{level}")


def unpool_matrix(
    laplacian: sparse.csr_matrix, parents: np.ndarray, coarse: int, order: int
) -> sparse.csr_matrix:
    """T_0(L) U ... T_order(L) U side by side, (N, (order + 1) * n), for `UnpoolConv`."""
    copies = copy_matrix(parents, coarse)
    return sparse.hstack([term @ copies for term in polynomials(laplacian, order)]).tocsr()
