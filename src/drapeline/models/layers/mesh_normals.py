"""Unit face normals that gradients flow through, for many samples of one topology at once."""

import numpy as np
import torch
from scipy import sparse
from torch import nn

from drapeline.models.layers.sparse_matrix import SparseMatrix

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
        (np.r_[ones, -ones], (np.r_[rows, rows], np.r_[to, start])),
        shape=(len(rows), vertices),
    )
