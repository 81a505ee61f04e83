"""Codes of garments from the silhouettes that a picture shows (SMPLicit 4.3, equation 6).

Of the points around the body that fall on a pixel of the garment, one at least lies on it: C = 0.
All others are off it, for which the paper asks C = d_max. A point closer to the silhouette than
d_max cannot be that far off, so here it has to be as far off as its pixel is from the garment's,
and d_max at most, unless `FitImage.clearance` is off. The paper adds up all points off the garment.
Here the worst point of each ray counts, so that both kinds of rays weigh alike, and of the rays
those whose loss is greatest.

Points are drawn around the body at rest and follow it into its pose. Those that the posed body does
not hide fall on pixels: of the garment, where some point along the pixel's ray lies on it, or of
something else, where none does. None of this depends on the garment's code, so it is found once.

The paper's prior is |z|. Codes of garments are not spread alike in all directions, and a code that
leaves them gives a field of no garment. The prior here is the mean square of w in
z = mean + F w, with F F^T the covariance of the training garments' codes; steps are taken in w.

B garments, P points, D numbers of a code, V vertices of the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from drapeline.bodies.follow import PosedBody, move, point_motions
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import face_normals
from drapeline.geometry.rays import rays_hit
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.settings import FitImage
from drapeline.models.training.optimise import CodePrior, CosineAdam, spread_codes
from drapeline.outfits.worn import SkinningOptions
from drapeline.rendering.camera import Camera

_SKIN_M = 2e-3  # rays towards the camera start this far off, so that the skin hides none of its own
_FAR_M = 1e4
_START_RAYS, _START_POINTS = 150, 8  # of either kind, and on each, that starts are compared at
_AT_ONCE = 2048  # points without gradients, whose activations stay in the processor's cache


def space_points(
    rng: np.random.Generator,
    body: PosedBody,
    box: tuple[np.ndarray, np.ndarray],
    *,
    count: int,
    reach_m: float,
) -> np.ndarray:
    """(P, 3) float32 points outside the body at rest, within a box and within reach of the skin.

    Args:
        box: lowest and highest corner, metres.
        count: of points drawn; those inside the body or beyond reach are dropped.
        reach_m: greatest distance from the body.
    """
    low = np.maximum(box[0], body.rest.min(axis=0) - reach_m)
    high = np.minimum(box[1], body.rest.max(axis=0) + reach_m)
    points = rng.uniform(low, high, (count, 3)).astype(np.float32)
    place, face = closest_points(points, body.rest, body.faces)
    away = points - place
    outside = np.einsum("pi,pi->p", away, face_normals(body.rest, body.faces[face])) > 0
    return points[outside & (np.linalg.norm(away, axis=1) < reach_m)]


def hidden_by_body(points: np.ndarray, body: PosedBody, camera: Camera) -> np.ndarray:
    """(P,) whether the posed body is between points (P, 3) of the world and the camera."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    way = camera.position - points
    length = np.linalg.norm(way, axis=1, keepdims=True)
    way /= length
    return rays_hit(
        points + _SKIN_M * way, way, body.posed, body.faces, reach_m=min(_FAR_M, length.max())
    )


@dataclass(frozen=True)
class RayPoints:
    """Points by the rays that they are on; a ray is a small square of pixels."""

    points: np.ndarray  # (P, 3) float32 at rest, ray by ray
    first: np.ndarray  # (R + 1,) the first point of each ray, and P
    # (P,) float32, distance of the points' pixels from the nearest one of the garment, at the depth
    # of the points: what is seen of the garment is no closer to them.
    clearance_m: np.ndarray

    def __len__(self) -> int:
        return len(self.first) - 1

    def members(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, M) indices of the points of some rays, the first repeated; which are no repeats."""
        count = np.diff(self.first)[rays]
        column = np.arange(count.max(initial=1))
        own = column < count[:, None]
        return self.first[rays][:, None] + np.where(own, column, 0), own


class SeenPoints(NamedTuple):
    """Points that a picture tells something about, all of them in sight."""

    on: RayPoints  # whose pixels show the garment
    off: RayPoints  # whose pixels show something else


def seen_points(
    points: np.ndarray,
    body: PosedBody,
    camera: Camera,
    garment: np.ndarray,
    unknown: np.ndarray,
    *,
    neighbours: int,
    ray_m: float,
) -> SeenPoints:
    """Points of the space around a body, as far as a picture tells about them.

    Args:
        points: (P, 3) at rest, outside the body.
        body: at rest and posed.
        garment: (H, W) bool, where the garment is seen.
        unknown: (H, W) bool, pixels that tell nothing about it.
        neighbours: see `point_motions`.
        ray_m: side of the squares of pixels that count as one ray, on the body.
    """
    posed = move(points, point_motions(points, body, neighbours))
    image, depth = camera.project(posed)
    pixel = np.floor(image).astype(np.int64)
    size = np.array([camera.width, camera.height])
    kept = (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < size).all(axis=1)
    kept[kept] = ~unknown[pixel[kept, 1], pixel[kept, 0]]
    kept[kept] = ~hidden_by_body(posed[kept], body, camera)
    points, pixel, depth = points[kept], pixel[kept], depth[kept]
    focal = camera.intrinsics[0, 0]
    side = max(1, round(ray_m * focal / float(np.median(depth)))) if len(depth) else 1
    column, row = pixel.T // side
    away_px = distance_transform_edt(~garment)[pixel[:, 1], pixel[:, 0]]
    clearance = (away_px * depth / focal).astype(np.float32)
    is_on = garment[pixel[:, 1], pixel[:, 0]]
    return SeenPoints(
        *(
            _by_rays(points[part], (row * camera.width + column)[part], clearance[part])
            for part in (is_on, ~is_on)
        )
    )


def _by_rays(points: np.ndarray, square: np.ndarray, clearance: np.ndarray) -> RayPoints:
    order = np.argsort(square, kind="stable")
    first = np.flatnonzero(np.diff(square[order], prepend=-1))
    return RayPoints(points[order], np.append(first, len(order)), clearance[order])


def skinning_options(settings: FitImage) -> SkinningOptions:
    """Options by which sheets follow the body into the pose."""
    return SkinningOptions(settings.neighbours, settings.smoothing)


class Evidence(NamedTuple):
    """Rays and points that count in a step."""

    on: torch.Tensor  # (B, R, S, 3) points on rays of the garment
    off: torch.Tensor  # (B, Q, T, 3) points on rays off it
    least: torch.Tensor  # (B, Q, T) least distances there, in units of d_max
    # (B, Q) of the rays off the garment: how many these stand for, per ray of it.
    weight: torch.Tensor


def query_of(model: GarmentField, evidence: Evidence, places: torch.Tensor) -> torch.Tensor:
    """(B, P, H0) what points add to the decoder's first joint layer, whatever the codes.

    Clusters (B, K, 3) are the wearers'.
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
        evidence: of B garments, or of one for all codes.
        query: of `query_of`, for this evidence.
        z: (B, D) codes.
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
        codes: (n, D) of the training garments.
        seen: what the picture tells of each garment; each has points on it and off it.
        places: (B, K, 3) clusters of the wearers.
    """
    prior = CodePrior.of(codes)
    starts = spread_codes(codes, settings.starts)
    start = prior.whiten(best_start(model, seen, places, starts, settings, rng))
    adam = CosineAdam(start, rate=settings.rate, steps=settings.rounds * settings.steps)
    for _ in range(settings.rounds):
        z = prior.codes(adam.x.detach())
        evidence = draw_evidence(model, seen, places, z, settings, rng)
        loss = partial(
            _fit_loss, model, evidence, query_of(model, evidence, places), prior, settings
        )
        for _ in range(settings.steps):
            adam.step(loss)
    return prior.codes(adam.x.detach())


def _fit_loss(
    model: GarmentField,
    evidence: Evidence,
    query: torch.Tensor,
    prior: CodePrior,
    settings: FitImage,
    w: torch.Tensor,
) -> torch.Tensor:
    """(B,) the loss of the codes of w (B, D), with their prior."""
    loss = image_loss(model, evidence, query, prior.codes(w), settings)
    return loss + settings.prior * w.square().mean(1)


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
    """(n,) indices of codes (n, D), the one with the least loss for a picture's garment first.

    Clusters (K, 3) are the wearer's.
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
