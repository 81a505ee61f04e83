"""Layers on graphs and meshes: sparse matrices, Chebyshev convolutions, hierarchies and normals.

Features are node-major tensors (N, B, F).
"""

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from scipy import sparse
from scipy.sparse.linalg import eigsh
from torch import nn

from drapeline.geometry.mesh import edge_graph
from drapeline.models.layers.linear import he_uniform


class SparseMatrix(nn.Module):
    """A constant (M, N) matrix that maps (N, ...) tensors to (M, ...) ones, differentiably."""

    forward_value: torch.Tensor

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
            unpool: (N, (order + 1) * n) matrices T_k(L) U side by side, see `unpool_matrix`.
        """
        wide = torch.matmul(x.flatten(0, 1), self.weight)  # (order + 1, n * B, outputs)
        return unpool(wide.view(-1, x.shape[1], wide.shape[-1])).flatten(0, 1) + self.bias


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

    slot_0: torch.Tensor
    place: torch.Tensor
    parents: torch.Tensor

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
        for name, index in (("place", np.argsort(by_size)), ("parents", parents)):
            table = torch.from_numpy(np.asarray(index, dtype=np.int64))
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
    """

    def __init__(
        self,
        edges: Sequence[np.ndarray],
        parents: Sequence[np.ndarray],
        order: int,
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


def unpool_matrix(
    laplacian: sparse.csr_matrix, parents: np.ndarray, coarse: int, order: int
) -> sparse.csr_matrix:
    """T_0(L) U ... T_order(L) U side by side, (N, (order + 1) * n), for `UnpoolConv`."""
    copies = copy_matrix(parents, coarse)
    return sparse.hstack([term @ copies for term in polynomials(laplacian, order)]).tocsr()


_SMALL_M2 = 1e-12


class FaceNormals(nn.Module):
    """Face normals of a fixed triangulation, in full or one part of the faces at a time.

    A part is a random share of all faces, so a loss on part `step % parts` has the loss on all
    faces as its mean over steps, at a fraction of the cost.

    Args:
        faces: (F, 3) vertex ids.
        vertices: number of vertices.
        parts: into how many parts the faces are split.
        rng: shuffles the faces.
    """

    def __init__(
        self, faces: np.ndarray, vertices: int, *, parts: int, rng: np.random.Generator
    ) -> None:
        super().__init__()
        order = rng.permutation(len(faces)) if parts > 1 else np.arange(len(faces))
        chosen = [faces[order[part::parts]] for part in range(parts)]
        self.edges = nn.ModuleList(SparseMatrix(_two_edges(f, vertices)) for f in chosen)
        for part, corners in enumerate(chosen):
            table = torch.from_numpy(corners.astype(np.int64))
            self.register_buffer(f"corners_{part}", table, persistent=False)

    def forward(self, vertices: torch.Tensor, part: int = 0) -> torch.Tensor:
        """(V, 3, B) metres -> (F / parts, 3, B) unit normals; near zero for a face without area."""
        edges = self.edges[part](vertices).unflatten(0, (2, -1))
        (ax, ay, az), (bx, by, bz) = (half.unbind(1) for half in edges)
        cross = torch.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], 1)
        return cross * torch.rsqrt((cross * cross).sum(1, keepdim=True) + _SMALL_M2**2)

    def mask(self, mask: torch.Tensor, part: int = 0) -> torch.Tensor:
        """(V, B) vertex mask -> (F / parts, B): faces whose three corners are all in it."""
        a, b, c = (mask[ids] for ids in getattr(self, f"corners_{part}").unbind(1))
        return a & b & c


def _two_edges(faces: np.ndarray, vertices: int) -> sparse.csr_matrix:
    """(2 F, V): corner 1 minus corner 0 of every face, then corner 2 minus corner 0."""
    rows = np.arange(2 * len(faces))
    to = np.concatenate([faces[:, 1], faces[:, 2]])
    start = np.tile(faces[:, 0], 2)
    ones = np.ones(len(rows))
    return sparse.csr_matrix(
        (np.r_[ones, -ones], (np.r_[rows, rows], np.r_[to, start])), shape=(len(rows), vertices)
    )
