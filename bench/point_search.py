"""Farthest points, balls and interpolated skinning weights, beside the usual ways with torch."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from side_by_side import Comparison, compare

from drapeline.bodies.model import load_body
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.geometry.mesh import vertex_normals
from drapeline.models.layers.point_search import BallSearch, farthest_points

_NO_FACES = np.zeros((0, 3), dtype=np.int32)
BALLS = ((0.02, 16), (0.1, 32), (0.4, 64))  # radius in metres, points


def loop_farthest(points: torch.Tensor, count: int) -> torch.Tensor:
    """The loop of PointNet++ in torch, from the first point on."""
    clouds = torch.arange(len(points))
    chosen = torch.zeros(len(points), count, dtype=torch.int64)
    distance = torch.full(points.shape[:2], torch.inf)
    last = chosen[:, 0]
    for step in range(count):
        chosen[:, step] = last
        away = ((points - points[clouds, last][:, None]) ** 2).sum(-1)
        distance = torch.minimum(distance, away)
        last = distance.argmax(-1)
    return chosen


def sorted_ball(
    points: torch.Tensor, centres: torch.Tensor, radius: float, count: int
) -> torch.Tensor:
    """All distances, a mask and a sort, as PointNet++ is written in torch."""
    index = torch.arange(points.shape[1]).repeat(1, centres.shape[1], 1)
    index[torch.cdist(centres, points) > radius] = points.shape[1]
    index = index.sort(dim=-1)[0][..., :count]
    return torch.where(index == points.shape[1], index[..., :1], index)


def gathered_weights(garment: torch.Tensor, body: torch.Tensor, weights: torch.Tensor) -> object:
    """All distances, the nearest, and their weights gathered, as Garment4D does."""
    distance, near = torch.cdist(garment, body).topk(256, largest=False)
    share = 1 / (distance + 1e-6)
    share = share / share.sum(-1, keepdim=True)
    table = weights.expand(len(garment), -1, -1)
    gathered = table.gather(1, near[..., None].expand(-1, -1, weights.shape[1]))
    return (share[..., None] * gathered).sum(1)


def rows(results: Path) -> Iterator[Comparison]:
    """Searches around the default body: its vertices, and points 5 to 40 mm in front of them."""
    body = load_body(results.parent / "resources/body/female.npz")
    rng = np.random.default_rng(0)
    surface = body.v_template
    gap = rng.uniform(0.005, 0.04, (len(surface), 1)).astype(np.float32)
    cloth = surface + gap * vertex_normals(surface, body.faces).astype(np.float32)
    cloth = cloth[rng.permutation(len(cloth))]

    for clouds, peer in ((1, "loop in torch"), (8, "the same, 8 clouds at once")):
        points = torch.from_numpy(
            np.stack([rng.permutation(surface)[:8192] for _ in range(clouds)])
        )
        same = torch.equal(farthest_points(points, 1024), loop_farthest(points, 1024))
        yield compare(
            f"1,024 farthest of 8,192 points, {clouds} cloud{'s'[: clouds - 1]}",
            peer,
            lambda points=points: loop_farthest(points, 1024),
            lambda points=points: farthest_points(points, 1024),
            goal=20,
            note="" if same else "not the same points",
        )
    points, centres = torch.from_numpy(surface)[None], torch.from_numpy(cloth[:10_000])[None]
    for radius, count in BALLS:
        yield compare(
            f"{count} of {len(surface):,} vertices within {100 * radius:g} cm of 10,000 points",
            "distances, mask and sort in torch",
            lambda r=radius, n=count: sorted_ball(points, centres, r, n),
            lambda r=radius, n=count: BallSearch(points, r)(centres, n),
            goal=30,
            repeats=5,
        )
    weights = torch.from_numpy(body.weights)
    yield compare(
        f"weights of {len(cloth):,} points from their 256 nearest of {len(surface):,} vertices",
        "distances, `topk` and `gather` in torch",
        lambda: gathered_weights(torch.from_numpy(cloth), points[0], weights),
        lambda: interpolated_weights(cloth, _NO_FACES, surface, body.weights, 256, 0),
        goal=4.5,
        repeats=5,
    )
