"""Whether made-up garments look like real ones: folds at several scales, hems, crossings, variety.

Nothing here needs a true garment to compare with, and nothing depends on how finely a garment is
meshed, so that garments of any topology are compared with one another.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from drapeline.geometry.crossings import Crossings
from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import Mesh, boundary_edges, boundary_loops, vertex_normals
from drapeline.geometry.smoothing import cotangent_laplacian
from drapeline.metrics.garment import surface_distances_mm

FOLD_SCALES_M = (0.01, 0.02, 0.04, 0.08)
_HEM_STEP_M, _HEM_SCALE_M = 0.003, 0.015
_HOLE_M = 0.1  # length of a boundary that is no hem
NEAR_SHARE = 0.9  # of real garments that have another real one as near as counts for near


def cloth_measures(mesh: Mesh) -> dict[str, float]:
    """Measures of a garment's triangles, in metres, by name; NaN of a garment without faces.

    `self_crossings` is the number of edges that pass through its own triangles. `folds_{s}cm_mm` is
    how high its folds are at a scale s, root mean square over its area: how far the cloth blurred
    over s stands out of itself blurred over 2 s, less the same blurred over 4 s, so that roundness
    is no fold. `hem_mm` is how ragged its boundaries are: their waves up to a few centimetres.
    """
    names = ["self_crossings", *(_fold_name(s) for s in FOLD_SCALES_M), "hem_mm"]
    if not len(mesh.faces):
        return dict.fromkeys(names, float("nan"))
    values = [self_crossings(mesh), *_folds_mm(mesh), _hem_mm(mesh)]
    return dict(zip(names, values, strict=True))


def self_crossings(mesh: Mesh) -> float:
    """Number of edges that pass through the mesh's own triangles; NaN without faces."""
    if not len(mesh.faces):
        return float("nan")
    crossing, _ = Crossings([mesh.vertices], [mesh.faces]).find([mesh.vertices])
    return float(crossing[0])


def _fold_name(scale_m: float) -> str:
    return f"folds_{100 * scale_m:.0f}cm_mm"


def _folds_mm(mesh: Mesh) -> list[float]:
    """Departures at each of the scales, away from boundaries, which blurring draws in."""
    points, triangles = mesh.vertices.astype(np.float64), mesh.faces
    area, stiffness = cotangent_laplacian(points, triangles)
    mass = sp.diags(area)

    # The heat equation blurs like a Gaussian whose deviation is the root of twice the time.
    def blur_of(scale_m: float) -> Callable[[np.ndarray], np.ndarray]:
        solve = symmetric_factor((mass + 0.5 * scale_m**2 * stiffness).tocsc()).solve
        return lambda values: solve(mass @ values)

    blurs = [blur_of(2.0**k * FOLD_SCALES_M[0]) for k in range(len(FOLD_SCALES_M) + 2)]
    blurred = [blur(points) for blur in blurs[:-1]]
    rim = points[np.unique(boundary_edges(triangles))]
    away = KDTree(rim).query(points)[0] if len(rim) else np.full(len(points), np.inf)
    out = []
    for k, scale in enumerate(FOLD_SCALES_M):
        normals = vertex_normals(blurred[k + 1], triangles)
        height = np.einsum("vi,vi->v", blurred[k] - blurred[k + 1], normals)
        height = height - blurs[k + 2](height)
        weight = area * (away >= min(2 * scale, 0.5 * float(away.max())))
        out.append(1e3 * float(np.sqrt(np.average(height**2, weights=weight))))
    return out


def _hem_mm(mesh: Mesh) -> float:
    """Root mean square height of the waves of boundaries; 0 without any.

    Both of two passes take what blurring leaves, so that round boundaries, which a single one
    would draw in, have no waves.
    """
    squares: list[np.ndarray] = [np.zeros(0)]
    for loop in boundary_loops(_without_corners(mesh.faces)):
        points = mesh.vertices[np.append(loop, loop[0])].astype(np.float64)
        way = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        count = int(way[-1] / _HEM_STEP_M)
        if way[-1] < _HOLE_M:
            continue
        at = np.arange(count) * way[-1] / count
        even = np.stack([np.interp(at, way, points[:, axis]) for axis in range(3)], axis=1)
        wave = np.fft.rfftfreq(count, way[-1] / count)
        waves = (1 - np.exp(-2 * (np.pi * wave * _HEM_SCALE_M) ** 2))[:, None] ** 2
        height = np.fft.irfft(waves * np.fft.rfft(even, axis=0), count, axis=0)
        squares.append((height**2).sum(axis=1))
    joined = np.concatenate(squares)
    return 1e3 * float(np.sqrt(joined.mean())) if len(joined) else 0.0


def _without_corners(faces: np.ndarray) -> np.ndarray:
    """Faces without those at vertices that lie on two boundaries, so that loops do not touch."""
    while len(faces):
        vertex, count = np.unique(boundary_edges(faces), return_counts=True)
        touching = np.isin(faces, vertex[count > 2]).any(axis=1)
        if not touching.any():
            break
        faces = faces[~touching]
    return faces


class Variety(NamedTuple):
    """How sampled garments lie among real ones."""

    covered_share: float  # of real garments that have one as near as real ones have real ones
    nearest_mm: float  # mean distance of real garments to the nearest sampled one
    precise_mm: float  # mean distance of sampled garments to the nearest real one


def garment_distance_mm(first: Mesh, second: Mesh) -> float:
    """Mean distance of the vertices of either garment to the other, both on the same body."""
    return float(np.mean(surface_distances_mm(first, second)))


def variety(
    sampled: Mapping[str, Sequence[Mesh]],
    held_out: Mapping[str, Sequence[Mesh]],
    real: Mapping[str, Sequence[Mesh]],
    distance: Callable[[Mesh, Mesh], float] = garment_distance_mm,
) -> Variety:
    """Coverage of, and distances to, held-out garments, of types that all three have.

    Args:
        sampled: garment type -> garments to be judged, on one body as all others are.
        held_out: real garments that no model was shown.
        real: others, as many of each type as there are sampled: how near they come to the held-out
            ones, but for the last tenth, counts for near.
    """
    nearest, among, precise = [], [], []
    for name in sampled.keys() & held_out.keys() & real.keys():
        away = _distances(held_out[name], sampled[name], distance)
        nearest.append(away.min(axis=1))
        precise.append(away.min(axis=0))
        among.append(_distances(held_out[name], real[name], distance).min(axis=1))
    if not nearest:
        return Variety(*3 * [float("nan")])
    found, near = np.concatenate(nearest), np.quantile(np.concatenate(among), NEAR_SHARE)
    return Variety(
        float((found <= near).mean()), float(found.mean()), float(np.concatenate(precise).mean())
    )


def _distances(
    first: Sequence[Mesh], second: Sequence[Mesh], distance: Callable[[Mesh, Mesh], float]
) -> np.ndarray:
    return np.array([[distance(one, other) for other in second] for one in first])
