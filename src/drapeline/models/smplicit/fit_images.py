"""Codes of garments from the silhouettes that a picture shows (SMPLicit 4.3, equation 6).

Points around the body that fall on pixels of the garment have some point on their ray on the
garment, C = 0; all others are off it. The paper asks for C = d_max of these; a point closer to the
silhouette than d_max cannot be that far off, so here each has to be as far off as its pixel is from
the garment's, and d_max at most, unless `FitImage.clearance` is switched off.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from drapeline.models.smplicit.image_points import SeenPoints
from drapeline.models.smplicit.network import GarmentField


@dataclass(frozen=True)
class FitImage:
    """How codes are fitted to a picture.

    Attributes:
        points: drawn in the model's box around the body.
        neighbours: vertices of the body that a point follows; 1 in the paper.
        ray_m: side of the squares of pixels that count as one ray, on the body.
        rays, off: rays of the garment, and points off it, that count in a step.
        starts: training codes that are tried as a start.
        rounds: how often these are drawn anew.
        steps: of Adam in each round.
        rate: the first learning rate; it falls to zero like a cosine.
        off_weight: of points off the garment.
        latent: weight of the code's mean absolute value.
        clearance: whether points near the silhouette may be closer to the garment than d_max.
    """

    points: int = 150_000
    neighbours: int = 8
    ray_m: float = 0.01
    rays: int = 400
    off: int = 3000
    starts: int = 32
    rounds: int = 6
    steps: int = 12
    rate: float = 0.05
    off_weight: float = 1.0
    latent: float = 0.02
    clearance: bool = True


class Evidence(NamedTuple):
    """What counts in a step, of B garments.

    Attributes:
        on: (B, R, S, 3) points on rays of the garment; rays with fewer repeat some.
        off: (B, Q, 3) points off it.
        least: (B, Q) least distances there, in units of d_max.
    """

    on: torch.Tensor
    off: torch.Tensor
    least: torch.Tensor


def image_loss(
    model: GarmentField,
    evidence: Evidence,
    places: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
) -> torch.Tensor:
    """(B,) equation 6, as means over rays and over points off the garment, plus the prior.

    Args:
        model: trained.
        evidence: of B garments.
        places: (B, K, 3) clusters of the wearers.
        z: (B, cut + style).
        settings: weights.
    """
    batch, rays, depth, _ = evidence.on.shape
    points = torch.cat([evidence.on.flatten(1, 2), evidence.off], 1)
    distance = model.predict(points, places, z)
    on, off = distance.split([rays * depth, evidence.off.shape[1]], 1)
    covered = on.abs().unflatten(1, (rays, depth)).amin(2).mean(1)
    short = evidence.least - off
    free = (short.relu() if settings.clearance else short.abs()).mean(1)
    return covered + settings.off_weight * free + settings.latent * z.abs().mean(1)
