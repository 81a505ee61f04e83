"""Terms shared by the losses of both stages (Garment4D equations 5, 6 and 8), all of them means."""

import igl
import numpy as np
import torch
from scipy import sparse
from torch import nn

from drapeline.geometry.smoothing import averaging_matrix
from drapeline.models.layers.graphs import SparseMatrix
from drapeline.models.layers.point_search import nearest_neighbours


def interpenetration(
    vertices: torch.Tensor, body: torch.Tensor, normals: torch.Tensor
) -> torch.Tensor:
    """Mean depth in metres under the tangent plane of the nearest body vertex (equation 5).

    Args:
        vertices: (B, N, 3) garments.
        body: (B, M, 3) body vertices.
        normals: (B, M, 3) their outward unit normals.

    Returns:
        A scalar; the choice of the nearest body vertex has no gradient.
    """
    _, nearest = nearest_neighbours(body.detach(), vertices.detach(), 1)
    nearest = nearest.expand(-1, -1, 3)  # (B, N, 3)
    away = vertices - body.gather(1, nearest)
    return torch.relu(-(away * normals.gather(1, nearest)).sum(-1)).mean()


class _Laplacian(nn.Module):
    """One fixed matrix L, applied to all meshes of a topology."""

    def __init__(self, matrix: sparse.spmatrix) -> None:
        super().__init__()
        self.matrix = SparseMatrix(matrix)

    def forward(self, vertices: torch.Tensor) -> torch.Tensor:
        """(..., N, 3) metres -> (..., N, 3) metres."""
        return self.matrix(vertices.movedim(-2, 0)).movedim(0, -2)


class CotangentLaplacian(_Laplacian):
    """The cotangent Laplacian of one mesh (libigl's), applied to all meshes of its topology.

    With one fixed L, Lx is linear in the vertices; the released code rebuilds it from every mesh
    instead.

    Args:
        vertices: (N, 3) the template, metres.
        faces: (F, 3).
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        super().__init__(
            igl.cotmatrix(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
        )


class UniformLaplacian(_Laplacian):
    """Takes each vertex to its offset to the mean of its neighbours.

    Args:
        faces: (F, 3).
        count: N.
    """

    def __init__(self, faces: np.ndarray, count: int) -> None:
        super().__init__(averaging_matrix(faces, count) - sparse.identity(count))


def laplacian_difference(
    laplacian: CotangentLaplacian,
    predicted: torch.Tensor,
    true: torch.Tensor,
    form: str = "paper",
) -> torch.Tensor:
    """Difference in roughness between two garments, mean over vertices (equation 6).

    Args:
        predicted, true: (..., N, 3) metres.
        form: "paper": | |Lx|^2 - |Ly|^2 |, in square metres. The paper prints it without the outer
            bars, but then the flattest garment would be best. "released": | |Lx| - |Ly| |, in
            metres, as in the released code for the canonical garment.
    """
    made, wanted = laplacian(predicted), laplacian(true)
    if form == "released":
        return (made.norm(dim=-1) - wanted.norm(dim=-1)).abs().mean()
    return (made.square().sum(-1) - wanted.square().sum(-1)).abs().mean()


def roughness(laplacian: UniformLaplacian, vertices: torch.Tensor) -> torch.Tensor:
    """Mean of |Lx| over vertices (..., N, 3), in metres.

    The released code uses it in place of equation 6 for posed garments.
    """
    return laplacian(vertices).norm(dim=-1).mean()


def temporal_difference(vertices: torch.Tensor, form: str = "paper") -> torch.Tensor:
    """Movement of vertices between frames, mean over vertices and steps (equation 8).

    Args:
        vertices: (B, T, N, 3) metres; 0 where T is 1.
        form: "paper": squared distance; "released": distance.
    """
    if vertices.shape[1] < 2:
        return vertices.new_zeros(())
    step = vertices[:, 1:] - vertices[:, :-1]
    return step.norm(dim=-1).mean() if form == "released" else step.square().sum(-1).mean()
