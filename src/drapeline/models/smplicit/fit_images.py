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
        on: (B, R, S, 3) points on rays of the garment.
        off: (B, Q, 3) points off it.
        least: (B, Q) least distances there, in units of d_max.
        drawn: of how many points these Q are the ones that matter.
    """

    on: torch.Tensor
    off: torch.Tensor
    least: torch.Tensor
    drawn: int


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
    rays, depth = evidence.on.shape[1:3]
    points = torch.cat([evidence.on.flatten(1, 2), evidence.off], 1)
    distance = model.predict(points, places, z)
    on, off = distance.split([rays * depth, evidence.off.shape[1]], 1)
    covered = on.abs().unflatten(1, (rays, depth)).amin(2).mean(1)
    short = evidence.least - off
    free = (short.relu() if settings.clearance else short.abs()).sum(1) / evidence.drawn
    return covered + settings.off_weight * free + settings.latent * z.abs().mean(1)


def fit_garments(
    model: GarmentField,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    starts: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> torch.Tensor:
    """(B, cut + style) codes of B garments that a picture shows.

    Args:
        model: trained.
        seen: what is known of each garment; each has points on and off it.
        places: (B, K, 3) clusters of the wearers.
        starts: (n, cut + style) codes, the best of which the fit starts from.
        settings: of the fit.
        rng: draws the points.
    """
    z = _best_start(model, seen, places, starts, settings, rng).requires_grad_(True)
    optimizer = torch.optim.Adam([z], lr=settings.rate)
    steps = settings.rounds * settings.steps
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(settings.rounds):
        evidence = draw_evidence(model, seen, places, z.detach(), settings, rng)
        for _ in range(settings.steps):
            loss = image_loss(model, evidence, places, z, settings)
            (z.grad,) = torch.autograd.grad(loss.sum(), z)
            optimizer.step()
            schedule.step()
    return z.detach()


def _best_start(model, seen, places, starts, settings, rng):
    chosen = []
    for one, place in zip(seen, places, strict=True):
        rays = _ray_points(one, rng.choice(_rays(one), min(_rays(one), 150), replace=False))
        index = np.concatenate([rays, np.repeat(rays[:, :1], max(0, 8 - rays.shape[1]), 1)], 1)
        off = rng.integers(len(one.off), size=600)
        evidence = Evidence(
            torch.from_numpy(one.on[index[:, :8]])[None],
            torch.from_numpy(one.off[off])[None],
            _least(model, one, off)[None],
            600,
        )
        with torch.no_grad():
            scores = [image_loss(model, evidence, place[None], z[None], settings) for z in starts]
        chosen.append(starts[int(torch.cat(scores).argmin())])
    return torch.stack(chosen)


def _rays(seen):
    return int(seen.ray.max()) + 1


def _least(model, seen, off):
    d = np.minimum(seen.clearance_m[off] / model.d_max_m, 1).astype(np.float32)
    return torch.from_numpy(d)


def _ray_points(seen, rays, key=None):
    """(R, S) indices, by key then random; padded by the first."""
    order = np.argsort(seen.ray, kind="stable") if key is None else np.lexsort((key, seen.ray))
    starts = np.searchsorted(seen.ray[order], np.arange(_rays(seen) + 1))
    count = np.diff(starts)[rays]
    col = np.arange(count.max())
    col = np.where(col < count[:, None], col, 0)
    return order[starts[:-1][rays][:, None] + col]


def draw_evidence(model, seen, places, z, settings, rng):
    on, off, least = [], [], []
    keep = 3
    for one, place, code in zip(seen, places, z, strict=True):
        rays = rng.choice(_rays(one), settings.rays, replace=_rays(one) < settings.rays)
        used = np.flatnonzero(np.isin(one.ray, rays))
        candidates = rng.choice(len(one.off), settings.off, replace=len(one.off) < settings.off)
        points = np.concatenate([one.on[used], one.off[candidates]])
        with torch.no_grad():
            d = model.predict(torch.from_numpy(points)[None], place[None], code[None])[0]
        key = np.full(len(one.on), np.inf, np.float32)
        key[used] = d[: len(used)].abs().numpy()
        index = _ray_points(one, rays, key)
        if index.shape[1] < keep:
            index = np.concatenate([index, np.repeat(index[:, :1], keep - index.shape[1], 1)], 1)
        on.append(torch.from_numpy(one.on[index[:, :keep]]))
        need = _least(model, one, candidates)
        short = need - d[len(used):]
        if not settings.clearance: short = short.abs()
        order = short.argsort(descending=True)[: settings.off // 4]
        off.append(torch.from_numpy(one.off[candidates[order.numpy()]]))
        least.append(need[order])
    return Evidence(torch.stack(on), torch.stack(off), torch.stack(least), settings.off)
