"""Garments moved to points: of a whole sequence, as in our model of point clouds, or of a scan.

Garments that networks or codes give need not touch the points. Cloth hardly stretches and moves
smoothly, so the edge lengths of the garment at rest and all frames together give a system of
equations for the vertices, which is linear and the same in every round.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from drapeline.geometry.closest import closest_points
from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import barycentric, edges
from drapeline.registration.settings import RefineSettings


class WornGarmentStatistics(NamedTuple):
    """Statistics of worn garments of a type against their skinned proposals."""

    shares: np.ndarray  # (K,) lengths of `springs` when worn, over those in the canonical garment
    error_m: np.ndarray  # (N,) root mean square error of the proposals, metres
    # (N,) share of the proposals' accelerations that the garments follow, 0 to 1.
    follow: np.ndarray


def springs(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertex pairs (K, 2): all edges, then corners that face one another; (K,) bool the latter."""
    along, across = edges(faces), pairs_across(faces)
    return np.concatenate([along, across]), np.arange(len(along) + len(across)) >= len(along)


def spring_lengths(vertices: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(..., K) distances of pairs (K, 2) of vertices (..., N, 3)."""
    away = vertices[..., pairs[:, 0], :] - vertices[..., pairs[:, 1], :]
    return np.linalg.norm(away, axis=-1)


def pairs_across(faces: np.ndarray) -> np.ndarray:
    """(K, 2) corners that face one another across an inner edge."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    apex = np.roll(faces, 1, axis=1).ravel()
    half = np.sort(half, axis=1)
    order = np.lexsort((half[:, 1], half[:, 0]))
    half, apex = half[order], apex[order]
    twin = (half[1:] == half[:-1]).all(axis=1)
    return np.stack([apex[:-1][twin], apex[1:][twin]], axis=1)


_APART_M = 4.0  # between frames that are laid out side by side for one search
_ROW = 16  # frames per row of that layout
_SMALL_M = 1e-9
_MOMENTUM = 0.9  # share of the last round's step that the next one starts with
_REACH_M = 0.06  # a point this far from the garment pulls half as hard as a close one
_DEEP_M = 0.05  # the surface nearest to vertices further inside is likely another limb's
_BODY_EVERY = 5  # rounds between searches for the nearest body vertices
_AROUND = 3  # points that have to be skin for a vertex to lie on it
_SKIN_NEAR = 2.0  # distances between points, within which skin is taken for seen
_SLIP_M = 0.2  # that hems slip over skin, at most
_USUAL_ERROR_M = 0.08  # of proposals, where no statistics are given


def fit_to_points(
    vertices: np.ndarray,
    points: np.ndarray,
    chosen: np.ndarray,
    faces: np.ndarray,
    rest: np.ndarray,
    body: np.ndarray,
    body_normals: np.ndarray,
    settings: RefineSettings,
    worn_statistics: WornGarmentStatistics | None = None,
    bare: np.ndarray | None = None,
) -> np.ndarray:
    """Garments (F, N, 3) float32 near the points, of the canonical lengths, smooth in time.

    Each round pulls every vertex towards the points whose nearest places on the garment it is a
    corner of, off skin that is seen, and out of the body. It then minimises the sum of squares of
    the remaining pulls, the changes of length, the accelerations and the changes from the start,
    which is a linear system. Its matrix is constant, so it is factorised once, separately for each
    frequency in time.

    Args:
        vertices: (F, N, 3) proposals for all frames of a sequence, root frame, metres.
        points: (F, P, 3).
        chosen: (F, P) bool, which points are the garment's; a frame may have none.
        faces: (E, 3) of the garment.
        rest: (N, 3) the canonical garment.
        body, body_normals: (F, M, 3) body vertices and outward unit normals.
        worn_statistics: of the type; if None, lengths are those at rest, all vertices start
            equally well, and accelerations are compared with zero, not with those of `vertices`.
        bare: (F, P) bool, which points are skin, see `SeenSkin`; none if None.
    """
    if worn_statistics is None:
        count = len(rest)
        worn_statistics = WornGarmentStatistics(
            np.ones(1), np.full(count, _USUAL_ERROR_M), np.zeros(count)
        )
    cloth = EdgeSprings(rest, faces, settings, worn_statistics.shares)
    keep = (settings.keep_m / np.maximum(worn_statistics.error_m, settings.keep_m)) ** 2
    start = np.asarray(vertices, dtype=np.float64)
    solver = SmoothnessSolver(cloth.stiffness, 1 + keep, len(start), settings.smooth)
    constant = keep[:, None] * start
    accelerations = solver.acceleration_gradient(start)
    constant += worn_statistics.follow[:, None] * accelerations
    garment, before = start, start
    skin = None if bare is None else SeenSkin(points, chosen, bare)
    for number in range(settings.rounds):
        ahead = garment + _MOMENTUM * (garment - before)
        if number % _BODY_EVERY == 0:
            nearest = _nearest_rows(body, ahead)
            goals = None if skin is None else skin.goals(ahead)
        pull = point_pull(ahead, points, chosen, faces, _REACH_M)
        if goals is not None:
            pull += np.nan_to_num(goals - ahead)
        pull += body_push(ahead, body, body_normals, nearest, settings.gap_m)
        before, garment = garment, solver(constant + ahead + pull + cloth.lengths(ahead))
    return garment.astype(np.float32)


class EdgeSprings:
    """Springs along edges and across them, at rest in the canonical garment.

    Args:
        rest: (N, 3) metres.
        faces: (E, 3).
        settings: `stretch` and `bend`.
        shares: (K,) or (1,) of their lengths at rest that the springs have when worn.
    """

    def __init__(
        self, rest: np.ndarray, faces: np.ndarray, settings: RefineSettings, shares: np.ndarray
    ) -> None:
        pairs, across = springs(faces)
        weights = np.where(across, float(settings.bend), float(settings.stretch))
        self._length = spring_lengths(rest, pairs) * shares
        rows = np.arange(len(pairs))
        ones = np.ones(len(pairs))
        self._difference = sparse.csr_matrix(
            (np.r_[ones, -ones], (np.r_[rows, rows], pairs.T.ravel())),
            shape=(len(pairs), len(rest)),
        )
        self._transposed = (self._difference.T @ sparse.diags(weights)).tocsr()
        self.stiffness = (self._transposed @ self._difference).tocsc()

    def lengths(self, garment: np.ndarray) -> np.ndarray:
        """(F, N, 3) weighted sums of each vertex's springs, at rest length in their direction."""
        frames, count, _ = garment.shape
        rows = garment.transpose(1, 0, 2).reshape(count, -1)
        spring = (self._difference @ rows).reshape(-1, frames, 3)
        length = np.linalg.norm(spring, axis=-1, keepdims=True)
        spring *= self._length[:, None, None] / np.maximum(length, _SMALL_M)
        out = self._transposed @ spring.reshape(len(spring), -1)
        return out.reshape(count, frames, 3).transpose(1, 0, 2)


class SmoothnessSolver:
    """(K + diag(d) + smooth D^T D) x = b, for all frames at once.

    D takes second differences in time. In the basis of the eigenvectors of D^T D the system falls
    apart into one system of N rows for each of them.

    Args:
        stiffness: K, (N, N).
        diagonal: d, (N,).
        frames: F.
        smooth: weight of the second differences.
    """

    def __init__(
        self, stiffness: sparse.csc_matrix, diagonal: np.ndarray, frames: int, smooth: float
    ) -> None:
        second = np.diff(np.eye(frames), 2, axis=0) if frames > 2 else np.zeros((1, frames))
        self._bend = smooth * second.T @ second
        values, self._vectors = np.linalg.eigh(self._bend)
        self._factors = [
            symmetric_factor(stiffness + sparse.diags(diagonal + max(value, 0.0)))
            for value in values
        ]

    def acceleration_gradient(self, garment: np.ndarray) -> np.ndarray:
        """smooth D^T D x, (F, N, 3)."""
        return np.tensordot(self._bend, garment, axes=(1, 0))

    def __call__(self, right: np.ndarray) -> np.ndarray:
        """x (F, N, 3) for b (F, N, 3)."""
        modes = np.tensordot(self._vectors, right, axes=(0, 0))
        solved = [factor.solve(mode) for factor, mode in zip(self._factors, modes, strict=True)]
        return np.tensordot(self._vectors, np.stack(solved), axes=(1, 0))


def point_pull(
    garment: np.ndarray, points: np.ndarray, chosen: np.ndarray, faces: np.ndarray, reach_m: float
) -> np.ndarray:
    """Mean offset from the garment to the points around each vertex, (F, N, 3) metres.

    Args:
        garment: (F, N, 3).
        points: (F, P, 3).
        chosen: (F, P) bool.
        faces: (E, 3).
        reach_m: distance at which a point counts half.
    """
    frames, count, _ = garment.shape
    frame, column = np.nonzero(chosen)
    if not len(frame):
        return np.zeros(garment.shape)
    number = np.arange(frames)
    place = _APART_M * np.stack([number % _ROW, number // _ROW, 0 * number], axis=1)
    cloud = points[frame, column].astype(np.float64)
    all_faces = (faces + count * number[:, None, None]).reshape(-1, 3)
    nearest, face = closest_points(
        cloud + place[frame], (garment + place[:, None]).reshape(-1, 3), all_faces
    )
    corners = all_faces[face]
    shares = barycentric(nearest - place[frame], garment.reshape(-1, 3)[corners])
    # From the shares rather than from `nearest`, which is rounded at some metres.
    offset = cloud - (garment.reshape(-1, 3)[corners] * shares[..., None]).sum(1)
    weight = shares / (1 + (np.linalg.norm(offset, axis=1) / reach_m) ** 2)[:, None]
    gather = sparse.csr_matrix(
        (weight.ravel(), corners.ravel(), np.arange(0, weight.size + 1, 3)),
        shape=(len(cloud), frames * count),
    )
    # A vertex with less than its usual share of points follows its neighbours more.
    usual = np.repeat(chosen.sum(1) / count, count)
    total = np.maximum(np.bincount(corners.ravel(), weight.ravel(), frames * count), usual)
    return (gather.T @ offset / np.maximum(total, _SMALL_M)[:, None]).reshape(garment.shape)


class SeenSkin:
    """Skin that is seen, where the garment cannot be.

    Points alone draw a garment to where it is. They do not tell a hem that it has slipped to
    above the knee, as long as the rest of the cloth is near them: bare knees do.

    Args:
        points: (F, P, 3) metres.
        chosen: (F, P) bool, the garment's.
        bare: (F, P) bool, of skin.
    """

    def __init__(self, points: np.ndarray, chosen: np.ndarray, bare: np.ndarray) -> None:
        self._clouds = [cKDTree(cloud) for cloud in points]
        self._cloths = [
            cKDTree(cloud[own]) if own.any() else None
            for cloud, own in zip(points, chosen, strict=True)
        ]
        self._bare = bare
        # Between the garment's own points, which may be fewer than those of skin.
        self._spacing_m = [
            float(np.median(tree.query(tree.data, k=2)[0][:, 1])) if tree and tree.n > 1 else 0.0
            for tree in self._cloths
        ]

    def goals(self, garment: np.ndarray) -> np.ndarray:
        """(F, N, 3) the garment's points nearest to vertices that lie on bare skin; NaN elsewhere.

        On bare skin, several points around a vertex are skin, and about as near as points are to
        one another. A single one may have a wrong label.
        """
        goals = np.full(garment.shape, np.nan)
        for frame, (cloud, cloth) in enumerate(zip(self._clouds, self._cloths, strict=True)):
            if cloth is None:
                continue
            away, around = cloud.query(garment[frame], k=min(_AROUND, cloud.n))
            near = away[:, 0] < _SKIN_NEAR * self._spacing_m[frame]
            off = near & self._bare[frame][around].all(axis=1)
            slipped_m, nearest = cloth.query(garment[frame, off])
            # Farther away, the labels are wrong rather than the place of the hem.
            near_cloth = slipped_m < _SLIP_M
            goals[frame, np.flatnonzero(off)[near_cloth]] = cloth.data[nearest[near_cloth]]
        return goals


def body_push(
    garment: np.ndarray, body: np.ndarray, normals: np.ndarray, nearest: np.ndarray, gap_m: float
) -> np.ndarray:
    """Offsets that move vertices to `gap_m` above the body, (F, N, 3) metres.

    Vertices deep inside are left to the points.

    Args:
        garment: (F, N, 3).
        body, normals: (F, M, 3).
        nearest: (F, N) the body vertex whose tangent plane is used.
        gap_m: least height over it, metres.
    """
    place = np.take_along_axis(body, nearest[..., None], axis=1)
    normal = np.take_along_axis(normals, nearest[..., None], axis=1)
    height = ((garment - place) * normal).sum(-1, keepdims=True)
    push = np.maximum(gap_m - height, 0) * (height > -_DEEP_M)
    return push * normal


def _nearest_rows(body: np.ndarray, garment: np.ndarray) -> np.ndarray:
    """(F, N) the nearest body vertex of each frame."""
    return np.stack([cKDTree(b).query(g)[1] for b, g in zip(body, garment, strict=True)])
