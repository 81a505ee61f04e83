"""Skinning weights of a garment, taken from the body that wears it.

`nearest_weights` follows the few body vertices under the cloth, as CLOTH3D's garments do;
`interpolated_weights` are Garment4D's (equation 2), blended from hundreds of vertices around.
"""

import math
from typing import Literal

import numpy as np
import scipy.sparse as sp
import warp as wp
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree, cKDTree

from drapeline.geometry.mesh import mean_edge_length, triangulate, vertex_normals
from drapeline.geometry.smoothing import averaging_matrix, blur
from drapeline.geometry.warp_mesh import start_warp

wp.set_module_options({"enable_backward": False})

_CELLS_PER_POINT = 4
_SAMPLED = 64  # points that tell how large cells should be
_SIDES = 3.5  # of cells, from a point to the last of its nearest ones


@wp.func
def _before(a: wp.float64, i: int, b: wp.float64, j: int):
    """Whether a point is nearer than another, or as near and has the lower index."""
    return a < b or (a == b and i < j)


@wp.func
def _sink(
    squared: wp.array[wp.float64],
    found: wp.array[int],
    top: int,
    away: wp.float64,
    index: int,
):
    """Put a point in a heap's place `top`, and farther ones from below above it."""
    count = squared.shape[0]
    slot = int(top)
    child = int(2 * top + 1)
    while child < count:
        if child + 1 < count:  # noqa: SIM102  (`and` asks for both)
            if _before(squared[child], found[child], squared[child + 1], found[child + 1]):
                child += 1
        if _before(squared[child], found[child], away, index):
            break
        squared[slot] = squared[child]
        found[slot] = found[child]
        slot = child
        child = 2 * slot + 1
    squared[slot] = away
    found[slot] = index


@wp.kernel
def _search(
    points: wp.array[wp.vec3d],
    index: wp.array[int],
    start: wp.array[int],
    cells: wp.vec3i,
    side: wp.float64,
    places: wp.array[wp.vec3d],
    at: wp.array[wp.vec3i],
    squared: wp.array2d[wp.float64],
    chosen: wp.array2d[int],
):
    """One thread per place looks into cells from ring to ring and keeps a heap, farthest on top.

    Args:
        points: sorted by cell, x first.
        index: of each point, before it was sorted.
        start: (cells + 1) where each cell starts.
        places: of the threads, and `at`, the cells they are in or nearest to.
        squared, chosen: the heaps.
    """
    thread = wp.tid()
    place = places[thread]
    heap = squared[thread]
    found = chosen[thread]
    width = heap.shape[0]
    x = at[thread][0]
    y = at[thread][1]
    z = at[thread][2]
    count = int(0)  # noqa: RUF046, UP018  (a plain number would be a constant)
    ring = int(0)  # noqa: RUF046, UP018
    reach = wp.float64(0.0)  # what lies outside of all rings so far is at least so far away
    while count < width or heap[0] >= reach * reach:
        if ring > wp.max(cells):
            return
        for k in range(wp.max(z - ring, 0), wp.min(z + ring + 1, cells[2])):
            for j in range(wp.max(y - ring, 0), wp.min(y + ring + 1, cells[1])):
                ends = wp.abs(k - z) < ring and wp.abs(j - y) < ring
                row = (k * cells[1] + j) * cells[0]
                for part in range(2):  # the whole row, or its first and its last cell
                    first = x - ring + 2 * ring * part
                    last = first
                    if not ends:
                        last = x + ring - (2 * ring + 1) * part
                    first = wp.max(first, 0)
                    last = wp.min(last, cells[0] - 1)
                    if first <= last:
                        for i in range(start[row + first], start[row + last + 1]):
                            away = wp.length_sq(points[i] - place)
                            if count < width:
                                heap[count] = away
                                found[count] = index[i]
                                count += 1
                                if count == width:
                                    for top in range(width // 2):
                                        slot = width // 2 - 1 - top
                                        _sink(heap, found, slot, heap[slot], found[slot])
                            elif _before(away, index[i], heap[0], found[0]):
                                _sink(heap, found, 0, away, index[i])
        reach = wp.float64(0.999999) * side * wp.float64(ring)
        ring += 1


def nearest_points(
    points: np.ndarray, places: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances (N, K) float64 and indices (N, K) int32 of the nearest, in any order.

    Of points that are as far, those with the lowest indices count as nearer.

    Args:
        points: (P, 3).
        places: (N, 3).
        count: K, at most P.
    """
    points, places = points.astype(np.float64), places.astype(np.float64)
    start_warp()
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    sample = points[:: max(1, len(points) // _SAMPLED)]
    distance, _ = cKDTree(points).query(sample, k=[count])
    side = max(float(np.median(distance)) / _SIDES, extent.max() / 1000, 1e-12)
    while math.prod(cells := [int(x / side) + 1 for x in extent]) > _CELLS_PER_POINT * len(points):
        side *= 1.25
    ids = _cells_of(points, low, side, cells) @ [1, cells[0], cells[0] * cells[1]]
    order = np.argsort(ids, kind="stable")
    start = np.searchsorted(ids[order], np.arange(math.prod(cells) + 1))
    squared = wp.zeros((len(places), count), dtype=wp.float64, device="cpu")
    chosen = wp.zeros((len(places), count), dtype=int, device="cpu")
    arrays = [
        (points[order], wp.vec3d),
        (order.astype(np.int32), int),
        (start.astype(np.int32), int),
    ]
    queries = [(places, wp.vec3d), (_cells_of(places, low, side, cells).astype(np.int32), wp.vec3i)]
    sources, targets = (
        [wp.array(values, dtype=dtype, device="cpu") for values, dtype in group]
        for group in (arrays, queries)
    )
    inputs = [*sources, wp.vec3i(*cells), side, *targets, squared, chosen]
    wp.launch(_search, dim=len(places), inputs=inputs, device="cpu")
    return squared.numpy(), chosen.numpy()


def _cells_of(points: np.ndarray, low: np.ndarray, side: float, cells: list[int]) -> np.ndarray:
    """(N, 3) the cell that each point is in or nearest to."""
    return np.clip(np.floor((points - low) / side), 0, np.array(cells) - 1).astype(np.int64)


# Keeps distances in metres from vanishing, so that one close vertex does not outweigh all others.
_SMALL_M = 1e-6
_COINCIDENT_M = 1e-9
_NEAREST = 8
# Distance that a turn of the normal by one radian counts for, as in registration: a sleeve does
# not take after the torso beside it.
_TURN_M = 0.1
_PASSES = 20


def nearest_weights(
    garment: np.ndarray,
    faces: np.ndarray,
    body: np.ndarray,
    body_faces: np.ndarray,
    weights: np.ndarray,
    *,
    reach_m: float = 0.0,
) -> np.ndarray:
    """Weights of the nearest body vertices that face the same way, smoothed over the garment.

    Args:
        garment: (V, 3) metres, in the body's rest pose.
        faces: (F, 3) or (F, 4) of the garment.
        body: (B, 3) in the rest pose.
        body_faces: (G, 3).
        weights: (B, K) of the body, rows sum to 1.
        reach_m: length over which the weights are then diffused, see `weight_reach_m`.

    Returns:
        (V, K) float32, rows sum to 1; zero for vertices without faces.
    """
    used = np.unique(faces)
    tree = KDTree(np.hstack([body, _TURN_M * vertex_normals(body, body_faces)]))
    normals = vertex_normals(garment, triangulate(faces))[used]
    distance, near = tree.query(np.hstack([garment[used], _TURN_M * normals]), k=_NEAREST)
    share = 1 / np.maximum(distance, _SMALL_M)
    share /= share.sum(axis=1, keepdims=True)
    out = np.zeros((len(garment), weights.shape[1]))
    out[used] = np.einsum("vk,vkj->vj", share, weights[near])
    out = blur(out, averaging_matrix(faces, len(garment)), _PASSES)
    out[used] /= out[used].sum(axis=1, keepdims=True)
    if reach_m:
        out = _diffuse(out, garment, faces, reach_m)
    return out.astype(np.float32)


def _diffuse(
    weights: np.ndarray, vertices: np.ndarray, faces: np.ndarray, reach_m: float
) -> np.ndarray:
    """Weights after one implicit step of diffusion.

    (1 + t (1 - A)) w' = w, where A averages over the neighbours; a walk of t steps gets as far as
    the square root of t edges. Pass quads as quads: their diagonals would drag hems aside.
    """
    average = averaging_matrix(faces, len(vertices))
    time = (reach_m / mean_edge_length(vertices, faces)) ** 2
    system = sp.identity(len(vertices)) * (1 + time) - time * average
    joints = weights.any(axis=0)
    out = np.zeros_like(weights)
    out[:, joints] = splu(system.tocsc()).solve(weights[:, joints])
    # Rows of vertices without faces are zero, and so they stay.
    return out


def interpolated_weights(
    garment: np.ndarray,
    faces: np.ndarray,
    body: np.ndarray,
    weights: np.ndarray,
    neighbours: int = 256,
    passes: int = 100,
    step: float = 0.1,
    power: int = 1,
    coincident: Literal["vertex", "released"] = "vertex",
) -> np.ndarray:
    """Equation 2 of Garment4D: (N, 24) float32 W_g = W_g^K I_w, smoothed over the garment.

    Args:
        garment: (N, 3) metres, in the pose and frame of `body`.
        faces: (F, 3) or (F, 4) of the garment.
        body: (V, 3) metres.
        weights: (V, 24) of the body, rows sum to 1.
        neighbours: K body vertices that each garment vertex takes after; at most V.
        passes: of uniform Laplacian smoothing.
        step: share of the way to the neighbours' mean that a pass goes.
        power: of the inverse distance; the released code has 2.
        coincident: what a garment vertex on a body vertex takes: "vertex", that one's weights
            alone; "released", those of all its other neighbours, as the released code does.
    """
    count = min(neighbours, len(body))
    squared, near = nearest_points(body, garment, count)
    distance = np.sqrt(squared)
    on = distance < _COINCIDENT_M
    share = 1 / (distance + _SMALL_M) ** power
    if coincident == "vertex":
        share[on.any(axis=1)] = 0
        share[on] = 1
    else:
        share[on & ~on.all(axis=1, keepdims=True)] = 0
    share /= share.sum(axis=1, keepdims=True)
    rows = np.arange(len(garment) + 1) * count
    # As one sparse product, which spares the (N, K, 24) array of gathered weights.
    blend = sp.csr_matrix((share.ravel(), near.ravel(), rows), shape=(len(garment), len(body)))
    out = blend @ np.asarray(weights, dtype=np.float64)
    smooth = _smoothing_step(faces, len(garment), step)
    for _ in range(passes):
        out = smooth @ out
    return out.astype(np.float32)


def _smoothing_step(faces: np.ndarray, count: int, step: float) -> sp.csr_matrix:
    """(N, N) matrix that moves every vertex a step of the way to the mean of its neighbours."""
    average = averaging_matrix(faces, count)
    has_neighbours = sp.diags((np.diff(average.indptr) > 0).astype(np.float64))
    return (sp.identity(count) + step * (average - has_neighbours)).tocsr()
