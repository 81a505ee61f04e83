"""Where the clusters are that points are measured from, on any body at rest (SMPLicit 3.2)."""

from collections.abc import Mapping

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES, rest_basis
from drapeline.frames import GENDERS

BASIS_ROWS = len(GENDERS) * (1 + SHAPES)


def cluster_basis(bodies: Mapping[str, BodyModel], clusters: np.ndarray) -> torch.Tensor:
    """(`BASIS_ROWS`, K, 3) float32 rows of `rest_basis` for some vertices (K,) of the bodies."""
    return torch.from_numpy(rest_basis(bodies)[:, clusters].astype(np.float32))


def cluster_places(basis: torch.Tensor, shape: torch.Tensor, gender: torch.Tensor) -> torch.Tensor:
    """(B, K, 3) clusters of bodies at rest, metres.

    Args:
        basis: of `cluster_basis`.
        shape: (B, 10).
        gender: (B,) 0 female, 1 male.
    """
    male = gender.to(shape)[:, None]
    one = torch.cat([torch.ones_like(male), shape], 1)
    factors = torch.cat([one * (1 - male), one * male], 1)
    return (factors @ basis.flatten(1)).unflatten(1, (-1, 3))
