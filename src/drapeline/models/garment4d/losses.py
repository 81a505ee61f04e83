"""Losses of both stages (Garment4D equations 4 and 7) and their terms (5, 6 and 8), all means."""

from collections.abc import Sequence
from typing import Any

import igl
import numpy as np
import torch
import torch.nn.functional as F
from scipy import sparse
from torch import nn

from drapeline.geometry.smoothing import averaging_matrix
from drapeline.models.garment4d.canonical import CanonicalOutput
from drapeline.models.garment4d.settings import CanonicalWeights, PosedWeights
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
    """Takes each of N vertices to its offset to the mean of its neighbours; faces are (F, 3)."""

    def __init__(self, faces: np.ndarray, count: int) -> None:
        super().__init__(averaging_matrix(faces, count) - sparse.identity(count))


def laplacian_difference(
    laplacian: CotangentLaplacian, predicted: torch.Tensor, true: torch.Tensor, form: str = "paper"
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
    """Movement of vertices (B, T, N, 3) between frames, mean over vertices and steps (equation 8).

    It is the distance in the form "released", and its square in "paper"; 0 where T is 1.
    """
    if vertices.shape[1] < 2:
        return vertices.new_zeros(())
    step = vertices[:, 1:] - vertices[:, :-1]
    return step.norm(dim=-1).mean() if form == "released" else step.square().sum(-1).mean()


def balance_labels(share: np.ndarray, balance: float) -> torch.Tensor:
    """(L,) weights of labels with shares (L,) of the training points; their mean over points is 1.

    Otherwise small garments would be the last to be told apart. A label without points has weight
    0.

    Args:
        share: of the training points that have each label.
        balance: see `CanonicalWeights`.
    """
    weights = np.zeros(len(share))
    weights[share > 0] = share[share > 0] ** -balance
    return torch.from_numpy(weights / (weights * share).sum()).float()


def canonical_loss(
    output: CanonicalOutput,
    labels: torch.Tensor,
    coefficients: torch.Tensor,
    canonical: torch.Tensor,
    body: torch.Tensor,
    body_normals: torch.Tensor,
    laplacian: CotangentLaplacian,
    weights: CanonicalWeights,
    label_weights: torch.Tensor | None = None,
) -> dict[str, torch.Tensor]:
    """Equation 4.

    Args:
        output: of B windows.
        labels: (B, T, P) int64 of the points.
        coefficients: (B, D) true alpha.
        canonical: (B, N, 3) true canonical garments, metres.
        body: (B, M, 3) vertices of the bodies in the rest pose, metres.
        body_normals: (B, M, 3) their outward unit normals.
        label_weights: (L,) of points by true label, see `balance_labels`; None for equal ones.

    Returns:
        Each term before it is weighted, and their weighted sum as "total". There is no term
        "segmentation" if the network has no segmentation.
    """
    terms = {
        "coefficients": (output.coefficients - coefficients).square().sum(-1).mean(),
        "vertices": (output.vertices - canonical).square().sum(-1).mean(),
        "interpenetration": interpenetration(output.vertices, body, body_normals),
        "laplacian": laplacian_difference(
            laplacian, output.vertices, canonical, weights.laplacian_form
        ),
    }
    if output.logits is not None:
        of_points = F.cross_entropy(
            output.logits.flatten(0, 2), labels.flatten(), label_weights, reduction="none"
        )
        terms["segmentation"] = of_points.mean()
    terms["total"] = sum(getattr(weights, name) * term for name, term in terms.items())
    return terms


def posed_loss(
    predictions: Sequence[torch.Tensor],
    target: torch.Tensor,
    body: torch.Tensor,
    body_normals: torch.Tensor,
    laplacian: CotangentLaplacian | UniformLaplacian,
    weights: PosedWeights,
) -> dict[str, torch.Tensor]:
    """Equation 7, summed over iterations, which all weigh the same.

    Args:
        predictions: (B, T, N, 3) after each iteration, metres.
        target: (B, T, N, 3).
        body, body_normals: (B, T, M, 3) body vertices and outward unit normals.
        laplacian: of the template; the cotangent one for the paper's form, else the uniform one.

    Returns:
        `vertices` (m^2), `interpenetration` (m), `laplacian` and `temporal`, each summed over
        iterations without its weight, and `total`.
    """
    names = ("vertices", "interpenetration", "laplacian", "temporal")
    terms: dict[str, Any] = dict.fromkeys(names, 0.0)
    skin, normals = body.flatten(0, 1), body_normals.flatten(0, 1)
    last_alone = weights.temporal_form == "released"
    for number, garment in enumerate(predictions, 1):
        parts = {
            "vertices": (garment - target).square().sum(-1).mean(),
            "interpenetration": interpenetration(garment.flatten(0, 1), skin, normals),
            "laplacian": roughness(laplacian, garment)
            if isinstance(laplacian, UniformLaplacian)
            else laplacian_difference(laplacian, garment, target),
        }
        if number == len(predictions) or not last_alone:
            parts["temporal"] = temporal_difference(garment, weights.temporal_form)
        terms |= {name: terms[name] + part for name, part in parts.items()}
    return {**terms, "total": sum(getattr(weights, name) * term for name, term in terms.items())}
