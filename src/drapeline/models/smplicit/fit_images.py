"""Codes of garments from the silhouettes that a picture shows (SMPLicit 4.3, equation 6).

Of the points around the body that fall on a pixel of the garment, one at least lies on it: C = 0.
All others are off it, for which the paper asks C = d_max. A point closer to the silhouette than
d_max cannot be that far off, so here it has to be as far off as its pixel is from the garment's,
and d_max at most, unless `FitImage.clearance` is off. The paper adds up all points off the garment.
Here the worst point of each ray counts, so that both kinds of rays weigh alike, and of the rays
those whose loss is greatest.

The paper's prior is |z|. Codes of garments are not spread alike in all directions, and a code that
leaves them gives a field of no garment. The prior here is the mean square of w in
z = mean + F w, with F F^T the covariance of the training garments' codes; steps are taken in w.

B garments.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from drapeline.models.smplicit.image_points import RayPoints, SeenPoints
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.settings import FitImage
from drapeline.outfits.worn import Wearing

_START_RAYS, _START_POINTS = 150, 8  # of either kind, and on each, that starts are compared at
_AT_ONCE = 2048  # points without gradients, whose activations stay in the processor's cache
_EASE = 1e-3  # of the codes' mean variance, added to all: there may be few of them


def wearing(settings: FitImage) -> Wearing:
    """How sheets follow the body into the pose."""
    return Wearing(settings.neighbours, settings.smoothing)


class CodePrior(NamedTuple):
    """How the codes of some garments are spread: z = mean + factor w.

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
        off: (B, Q, T, 3) points on rays off it.
        least: (B, Q, T) least distances there, in units of d_max.
        weight: (B, Q) of the rays off the garment: how many these stand for, per ray of it.
    """

    on: torch.Tensor
    off: torch.Tensor
    least: torch.Tensor
    weight: torch.Tensor


def query_of(model: GarmentField, evidence: Evidence, places: torch.Tensor) -> torch.Tensor:
    """(B, P, H0) what the points add to the decoder's first joint layer, whatever the codes.

    Args:
        model: trained.
        evidence: of B garments.
        places: (B, K, 3) clusters of the wearers.
    """
    points = torch.cat([evidence.on.flatten(1, 2), evidence.off.flatten(1, 2)], 1)
    with torch.no_grad():
        return model.decoder.query(points, *model.decoder.fold(places))


def image_loss(
    model: GarmentField,
    evidence: Evidence,
    query: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
) -> torch.Tensor:
    """(B,) equation 6, a mean over the garment's rays to which those off it are added.

    Args:
        model: trained.
        evidence: of B garments, or of one for all codes.
        query: of `query_of`, for this evidence.
        z: (B, D) codes.
        settings: weights.
    """
    on_rays, off_rays = evidence.on.shape[1:3], evidence.off.shape[1:3]
    decoder = model.decoder
    base = decoder.base(*z.split([decoder.cut, decoder.style], 1))
    distance = decoder.joint(query + base[:, None])
    on, off = distance.split([on_rays.numel(), off_rays.numel()], 1)
    uncovered = on.abs().unflatten(1, on_rays).amin(2).mean(1)
    short = _short(evidence.least, off.unflatten(1, off_rays), settings).amax(2)
    return uncovered + settings.off_weight * (evidence.weight * short).sum(1)


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
    starts = spread_codes(codes, settings.starts)
    w = prior.whiten(best_start(model, seen, places, starts, settings, rng)).clone()
    w.requires_grad_(True)
    optimizer = torch.optim.Adam([w], lr=settings.rate)
    steps = settings.rounds * settings.steps
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(settings.rounds):
        evidence = draw_evidence(model, seen, places, prior.codes(w.detach()), settings, rng)
        query = query_of(model, evidence, places)
        for _ in range(settings.steps):
            loss = image_loss(model, evidence, query, prior.codes(w), settings)
            loss = loss + settings.prior * w.square().mean(1)
            (w.grad,) = torch.autograd.grad(loss.sum(), w)
            optimizer.step()
            schedule.step()
    return prior.codes(w.detach())


def best_start(
    model: GarmentField,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    starts: np.ndarray,
    settings: FitImage,
    rng: np.random.Generator,
) -> torch.Tensor:
    """(B, D) the code of `starts` (n, D) with the least loss, for each garment."""
    best = [
        rank_codes(model, points, place, starts, settings, rng)[0]
        for points, place in zip(seen, places, strict=True)
    ]
    return torch.from_numpy(starts[best])


def rank_codes(
    model: GarmentField,
    points: SeenPoints,
    place: torch.Tensor,
    codes: np.ndarray,
    settings: FitImage,
    rng: np.random.Generator,
) -> np.ndarray:
    """(n,) indices of codes (n, D), the one with the least loss for a garment first.

    Args:
        model: trained.
        points: what the picture tells of the garment.
        place: (K, 3) clusters of the wearer.
        codes: to compare.
        settings: weights.
        rng: draws the points that they are compared at.
    """
    # The points of a ray are in random order.
    on, off = (
        part.members(rng.choice(len(part), min(len(part), _START_RAYS), replace=False))[0]
        for part in points
    )
    on, off = on[:, :_START_POINTS], off[:, :_START_POINTS]
    evidence = Evidence(
        torch.from_numpy(points.on.points[on])[None],
        torch.from_numpy(points.off.points[off])[None],
        _least(model, points.off, off, settings)[None],
        torch.full((1, len(off)), len(points.off) / (len(points.on) * len(off))),
    )
    query = query_of(model, evidence, place[None])
    with torch.no_grad():
        # One by one, so that activations stay in the processor's cache.
        losses = [
            image_loss(model, evidence, query, z, settings)
            for z in torch.from_numpy(codes.astype(np.float32)).split(1)
        ]
    return torch.cat(losses).argsort(stable=True).numpy()


def _least(
    model: GarmentField, off: RayPoints, index: np.ndarray, settings: FitImage
) -> torch.Tensor:
    """Distances, in units of d_max, that points off the garment have at least."""
    if not settings.clearance:
        return torch.ones(index.shape)
    return torch.from_numpy(off.clearance_m[index] / model.d_max_m).clamp(max=1)


def draw_evidence(
    model: GarmentField,
    seen: Sequence[SeenPoints],
    places: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> Evidence:
    """Rays and points that count in the next steps, given the codes z (B, D) so far.

    The other points of these rays decide nothing for now, and the other rays off the garment are
    far enough from it.
    """
    parts = [
        _evidence_of_one(model, points, place[None], code[None], settings, rng)
        for points, place, code in zip(seen, places, z, strict=True)
    ]
    return Evidence(*(torch.stack(part) for part in zip(*parts, strict=True)))


def _evidence_of_one(
    model: GarmentField,
    points: SeenPoints,
    place: torch.Tensor,
    z: torch.Tensor,
    settings: FitImage,
    rng: np.random.Generator,
) -> Evidence:
    wanted = settings.rays
    on, off = points
    on_index, on_own = on.members(rng.choice(len(on), wanted, replace=len(on) < wanted))
    off_index, off_own = off.members(
        rng.choice(len(off), 3 * wanted, replace=len(off) < 3 * wanted)
    )
    looked = [on.points[on_index[on_own]], off.points[off_index[off_own]]]
    every = torch.from_numpy(np.concatenate(looked))[None]
    with torch.no_grad():
        distance = torch.cat([model.predict(p, place, z)[0] for p in every.split(_AT_ONCE, 1)])
    on_distance, off_distance = distance.split([*map(len, looked)])
    on_index, _ = _first(on_index, on_own, on_distance.abs(), settings.near)
    least = _least(model, off, off_index[off_own], settings)
    short = _short(least, off_distance, settings)
    off_index, worst = _first(off_index, off_own, -short, settings.near)
    chosen = np.argsort(worst, kind="stable")[:wanted]
    off_index = off_index[chosen]
    return Evidence(
        torch.from_numpy(on.points[on_index]),
        torch.from_numpy(off.points[off_index]),
        _least(model, off, off_index, settings),
        torch.full((len(off_index),), len(off) / (len(on) * 3 * wanted)),
    )


def _first(
    index: np.ndarray, own: np.ndarray, value: torch.Tensor, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of each ray the points (R, count) with the least values, and the least value (R,).

    Args:
        index, own: (R, M) points, see `RayPoints.members`.
        value: of the points that are no repeats.
        count: of points; a ray with fewer repeats the first.
    """
    table = np.full(own.shape, np.inf, dtype=np.float32)
    table[own] = value
    order = np.argsort(table, axis=1)[:, np.minimum(np.arange(count), own.shape[1] - 1)]
    sorted_ = np.take_along_axis(table, order, 1)
    order = np.where(np.isfinite(sorted_), order, order[:, :1])
    return np.take_along_axis(index, order, 1), sorted_[:, 0]
