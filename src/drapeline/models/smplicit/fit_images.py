"""Codes of garments from the silhouettes that a picture shows (SMPLicit 4.3, equation 6).

Of the points around the body that fall on a pixel of the garment, one at least lies on it: C = 0.
All others are off it, for which the paper asks C = d_max. A point closer to the silhouette than
d_max cannot be that far off, so here it has to be as far off as its pixel is from the garment's,
and d_max at most; `FitImage.clearance` switches back to the paper's form.

The paper's prior is |z|. Codes of garments are not spread alike in all directions, and a code that
leaves them gives a field of no garment. The prior here is the mean square of w in
z = mean + F w, with F F^T the covariance of the training garments' codes; steps are taken in w.

B garments.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from drapeline.models.smplicit.image_points import SeenPoints
from drapeline.models.smplicit.network import GarmentField

_START_RAYS, _START_OFF = 150, 600  # points that starts are compared at
_BATCH = 8  # starts that are looked at together
_EASE = 1e-3  # of the codes' mean variance, added to all: there may be few of them
_BEST = 4  # points off the garment of which one counts in a step


@dataclass(frozen=True)
class FitImage:
    """How codes are fitted to a picture.

    Attributes:
        points: drawn in the model's box around the body.
        neighbours: vertices of the body that a point follows; 1 in the paper.
        ray_m: side of the squares of pixels that count as one ray, on the body, in metres.
        rays: of the garment that count in a step.
        off: points off the garment, of which the quarter that violates the loss most counts.
        near: points of a ray, the nearest to the garment, that count in a step.
        starts: training codes that are tried as a start, beside their mean.
        rounds: how often points are chosen anew.
        steps: of Adam in each round.
        rate: the first learning rate, of w; it falls to zero like a cosine.
        off_weight: of points off the garment.
        prior: weight of the mean square of w.
        clearance: whether points near the silhouette may be closer to the garment than d_max.
        least_px: garments with fewer pixels are left out.
        smoothing: passes that smooth the motions of a sheet into the pose.
    """

    points: int = 150_000
    neighbours: int = 8
    ray_m: float = 0.01
    rays: int = 400
    off: int = 3000
    near: int = 3
    starts: int = 32
    rounds: int = 6
    steps: int = 10
    rate: float = 0.2
    off_weight: float = 1.0
    prior: float = 0.1
    clearance: bool = True
    least_px: int = 50
    smoothing: int = 20


class CodePrior(NamedTuple):
    """How the codes of a model's garments are spread: z = mean + factor w.

    Attributes:
        mean: (D,).
        factor: (D, D) lower triangle.
    """

    mean: torch.Tensor
    factor: torch.Tensor

    def codes(self, w: torch.Tensor) -> torch.Tensor:
        """(B, D) codes of w (B, D)."""
        return self.mean + w @ self.factor.T

    def whiten(self, z: torch.Tensor) -> torch.Tensor:
        """(B, D) w of codes (B, D)."""
        return torch.linalg.solve_triangular(self.factor, (z - self.mean).T, upper=False).T


def code_prior(codes: np.ndarray) -> CodePrior:
    """The prior of training codes (n, D)."""
    z = np.asarray(codes, dtype=np.float64)
    covariance = np.cov(z.T, bias=True)
    covariance += (
        _EASE * max(np.trace(covariance) / len(covariance), 1e-6) * np.eye(len(covariance))
    )
    factor = np.linalg.cholesky(covariance)
    return CodePrior(
        *(torch.from_numpy(part.astype(np.float32)) for part in (z.mean(axis=0), factor))
    )


def spread_codes(codes: np.ndarray, count: int) -> np.ndarray:
    """(m, D) the mean of codes (n, D) and `count` of them that are far from one another."""
    mean = codes.mean(axis=0)
    chosen, away = [mean], np.linalg.norm(codes - mean, axis=1)
    for _ in range(min(count, len(codes))):
        chosen.append(codes[int(away.argmax())])
        away = np.minimum(away, np.linalg.norm(codes - chosen[-1], axis=1))
    return np.stack(chosen).astype(np.float32)


class Evidence(NamedTuple):
    """What counts in a step.

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
    """(B,) equation 6, as means over rays and over points off the garment.

    Args:
        model: trained.
        evidence: of B garments.
        places: (B, K, 3) clusters of the wearers.
        z: (B, D) codes.
        settings: weights.
    """
    rays, near = evidence.on.shape[1:3]
    points = torch.cat([evidence.on.flatten(1, 2), evidence.off], 1)
    distance = model.predict(points, places, z)
    on, off = distance.split([rays * near, evidence.off.shape[1]], 1)
    covered = on.abs().unflatten(1, (rays, near)).amin(2).mean(1)
    short = _short(evidence.least, off, settings).sum(1) / evidence.drawn
    return covered + settings.off_weight * short


def _short(least: torch.Tensor, distance: torch.Tensor, settings: FitImage) -> torch.Tensor:
    """By how much points off the garment are too close to it."""
    return (least - distance).relu() if settings.clearance else (least - distance).abs()


def fit_garments(
    model: GarmentField,
    codes: np.ndarray,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> torch.Tensor:
    """(B, D) codes of B garments that a picture shows.

    Args:
        model: trained.
        codes: (n, D) of the training garments.
        seen: what the picture tells of each garment; each has points on it and off it.
        places: (B, K, 3) clusters of the wearers.
        settings: of the fit.
        rng: draws the points.
    """
    prior = code_prior(codes)
    starts = torch.from_numpy(spread_codes(codes, settings.starts))
    w = prior.whiten(best_start(model, seen, places, starts, settings, rng)).clone()
    w.requires_grad_(True)
    optimizer = torch.optim.Adam([w], lr=settings.rate)
    steps = settings.rounds * settings.steps
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(settings.rounds):
        evidence = draw_evidence(model, seen, places, prior.codes(w.detach()), settings, rng)
        for _ in range(settings.steps):
            loss = image_loss(model, evidence, places, prior.codes(w), settings)
            loss = loss + settings.prior * w.square().mean(1)
            (w.grad,) = torch.autograd.grad(loss.sum(), w)
            optimizer.step()
            schedule.step()
    return prior.codes(w.detach())


def best_start(
    model: GarmentField,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    starts: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> torch.Tensor:
    """(B, D) the code of `starts` (n, D) with the least loss, for each garment."""
    chosen = []
    for points, place in zip(seen, places, strict=True):
        rays = rng.choice(points.rays, min(points.rays, _START_RAYS), replace=False)
        index, _ = _points_of_rays(points, rays)
        off = rng.integers(len(points.off), size=_START_OFF)
        evidence = Evidence(
            torch.from_numpy(points.on[index])[None],
            torch.from_numpy(points.off[off])[None],
            _least(model, points, off, settings)[None],
            _START_OFF,
        )
        with torch.no_grad():
            scores = [
                image_loss(
                    model, _of_all(evidence, len(z)), place.expand(len(z), -1, -1), z, settings
                )
                for z in starts.split(_BATCH)
            ]
        chosen.append(starts[int(torch.cat(scores).argmin())])
    return torch.stack(chosen)


def _of_all(evidence: Evidence, count: int) -> Evidence:
    on, off, least = (
        part.expand(count, *part.shape[1:]) for part in (evidence.on, evidence.off, evidence.least)
    )
    return Evidence(on, off, least, evidence.drawn)


def _points_of_rays(points: SeenPoints, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, M) indices of all points of some rays, the first repeated; and which are not repeats."""
    count = np.diff(points.first)[rays]
    column = np.arange(count.max())
    own = column < count[:, None]
    return points.first[rays][:, None] + np.where(own, column, 0), own


def _least(
    model: GarmentField, points: SeenPoints, off: np.ndarray, settings: FitImage
) -> torch.Tensor:
    """Distances, in units of d_max, that points off the garment have at least."""
    if not settings.clearance:
        return torch.ones(len(off))
    return torch.from_numpy(points.clearance_m[off] / model.d_max_m).clamp(max=1)


def draw_evidence(
    model: GarmentField,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> Evidence:
    """Rays and points that count in the next steps, given the codes z (B, D) so far.

    The other points of these rays are further from the garment, and the other points off it are
    far enough from it, so that their gradient is zero for now.
    """
    parts = [
        _evidence_of_one(model, points, place[None], code[None], settings, rng)
        for points, place, code in zip(seen, places, z, strict=True)
    ]
    return Evidence(*(torch.stack(part) for part in zip(*parts, strict=True)), settings.off)


def _evidence_of_one(
    model: GarmentField,
    points: SeenPoints,
    place: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rays = rng.choice(points.rays, settings.rays, replace=points.rays < settings.rays)
    off = rng.choice(len(points.off), settings.off, replace=len(points.off) < settings.off)
    index, own = _points_of_rays(points, rays)
    looked = torch.from_numpy(np.concatenate([points.on[index[own]], points.off[off]]))
    with torch.no_grad():
        distance = model.predict(looked[None], place, z)[0]
    on = np.full(own.shape, np.inf, dtype=np.float32)
    on[own] = distance[: own.sum()].abs()
    # A ray with fewer points than wanted repeats its nearest.
    order = np.argsort(on, axis=1)[:, np.minimum(np.arange(settings.near), own.shape[1] - 1)]
    order = np.where(np.isfinite(np.take_along_axis(on, order, 1)), order, order[:, :1])
    least = _least(model, points, off, settings)
    short = _short(least, distance[own.sum() :], settings)
    worst = short.topk(settings.off // _BEST).indices
    return (
        torch.from_numpy(points.on[np.take_along_axis(index, order, 1)]),
        torch.from_numpy(points.off[off[worst.numpy()]]),
        least[worst],
    )
