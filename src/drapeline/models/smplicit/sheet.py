"""From the closed walls around a garment to its open surface, which the paper does not have.

Walls at a distance t surround the cloth: an outer side, an inner side, and half a tube along each
opening, whose crest is the hem. The outer side alone is kept and moved onto the cloth.

1. Vertices of the walls are told apart by whether their normals point away from the body. Normals
   alone are noisy, so labels are diffused over the walls, as random walks segment images (Grady
   2006), except across the crests: there, two thresholds behind a vertex lies no opposite wall but
   the cloth itself.
2. The outer side is cut off along the change of label, through the crests, and pieces and holes
   too small for garments are removed.
3. Each vertex goes back along its normal, half the way to the opposite wall. Fields are learned
   best some way off the cloth, so this is more accurate than the distance at the vertex; near the
   crests, where there is no opposite wall, the vertex follows the field's gradient instead, as
   Chibane et al. (2020) project points onto unsigned fields.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import cg

from drapeline.geometry.mesh import Mesh, boundary_loops, edges
from drapeline.geometry.smoothing import averaging_matrix, blur, smooth
from drapeline.metrics.garment import piece_indices
from drapeline.models.smplicit.fields import Field

_DIFFUSION = 100.0  # weight of equal labels of neighbours, against the normals
_CREST_WEIGHT, _CREST_POWER = 1e-3, 6
_SMALL_HOLE_M = 0.12  # around; no opening of a garment is smaller
_CREST = 0.8  # share of the threshold below which the opposite wall counts as missing
_LIFT_PASSES, _HEM_PASSES, _NEAR_HEM_PASSES, _PASSES = 8, 10, 10, 3


class _Side(NamedTuple):
    """Part of the walls: triangles, unit normals, and the field behind each vertex."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    behind_m: np.ndarray

    def within(self, faces: np.ndarray) -> "_Side":
        """Some of its faces (F, 3), and the vertices of these."""
        used, corners = np.unique(faces, return_inverse=True)
        return _Side(
            self.vertices[used],
            corners.reshape(faces.shape),
            self.normals[used],
            self.behind_m[used],
        )


def extract_sheet(field: Field, walls: Mesh, threshold_m: float, outward: np.ndarray) -> Mesh:
    """The open surface within walls.

    Args:
        field: that the walls were extracted from.
        walls: closed surface at a distance from the cloth, triangles.
        threshold_m: that distance, metres.
        outward: (V, 3) unit vectors away from the body at the vertices of the walls, roughly.

    Returns:
        One connected piece with faces that look away from the body; without faces if nothing on the
        walls does.
    """
    if not len(walls.faces):
        return walls
    vertices = walls.vertices.astype(np.float64)
    normals, areas = _normals(vertices, walls.faces)
    behind_m = field.distances((vertices - 2 * threshold_m * normals).astype(np.float32))
    walls_side = _Side(vertices, walls.faces, normals, behind_m.astype(np.float64))
    label = _outer_labels(walls_side, areas, threshold_m, outward)
    if not (label > 0).any():
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    side = _outer_side(walls_side, label)
    side = side.within(side.faces[piece_indices(Mesh(*side[:2]))[side.faces[:, 0]] == 0])
    return _laid_on_cloth(field, _fill_small_holes(side, threshold_m), threshold_m)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (V, 3) of vertices, and their areas (V,) in any unit."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    count = len(vertices)
    sums = np.stack([np.bincount(faces.ravel(), cross[:, k], count) for k in range(3)], axis=1)
    area = np.linalg.norm(sums, axis=1)
    return sums / np.maximum(area, 1e-20)[:, None], area


def _outer_labels(
    side: _Side, areas: np.ndarray, threshold_m: float, outward: np.ndarray
) -> np.ndarray:
    """(V,) positive on the outer side of the walls."""
    pairs = edges(side.faces)
    facing = np.clip(side.behind_m / threshold_m, 0, 1)
    alike = np.maximum(facing[pairs].min(axis=1) ** _CREST_POWER, _CREST_WEIGHT) * _DIFFUSION
    count = len(side.vertices)
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    links = sp.csr_matrix((np.tile(alike, 2), tuple(ends)), (count, count))
    share = areas / areas.mean()
    diagonal = share + np.asarray(links.sum(axis=1)).ravel()
    seen = np.einsum("vi,vi->v", side.normals, outward)
    label, _ = cg(
        (sp.diags(diagonal) - links).tocsr(),
        share * seen,
        x0=seen,
        rtol=1e-3,
        maxiter=1000,
        M=sp.diags(1 / diagonal),
    )
    return label


def _outer_side(side: _Side, label: np.ndarray) -> _Side:
    """The part with positive labels (V,), cut through faces where labels change sign."""
    outer = label > 0
    corners = outer[side.faces].sum(axis=1)
    one = _first_corner(side.faces[corners == 1], outer)
    two = _first_corner(side.faces[corners == 2], ~outer)
    # Edges that are cut, each from its outer to its inner end.
    cut = np.concatenate([one[:, [0, 1]], one[:, [0, 2]], two[:, [1, 0]], two[:, [2, 0]]])
    count = len(label)
    key, new = np.unique(cut[:, 0].astype(np.int64) * count + cut[:, 1], return_inverse=True)
    start, end = np.divmod(key, count)
    # No sliver is cut off: vertices would all but coincide.
    share = np.clip(label[start] / (label[start] - label[end]), 0.05, 0.95)[:, None]
    first, second, third, fourth = np.split(new + count, np.cumsum([len(one), len(one), len(two)]))
    faces = np.concatenate(
        [
            side.faces[corners == 3],
            np.stack([one[:, 0], first, second], axis=1),
            np.stack([two[:, 1], two[:, 2], fourth], axis=1),
            np.stack([two[:, 1], fourth, third], axis=1),
        ]
    )
    parts = (side.vertices, side.normals, side.behind_m[:, None])
    vertices, normals, behind_m = (
        np.concatenate([part, (1 - share) * part[start] + share * part[end]]) for part in parts
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
    return _Side(vertices, faces, normals, behind_m[:, 0]).within(faces)


def _first_corner(faces: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Faces (F, 3) turned so that their only chosen vertex comes first."""
    turn = (chosen[faces].argmax(axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, turn, axis=1)


def _fill_small_holes(side: _Side, threshold_m: float) -> _Side:
    """Close holes by a vertex in their middle."""
    vertices, faces, normals, behind_m = side
    for loop in boundary_loops(faces):
        around = np.linalg.norm(vertices[loop] - vertices[np.roll(loop, 1)], axis=1).sum()
        if around >= _SMALL_HOLE_M:
            continue
        fan = np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(vertices))], axis=1)
        normal = normals[loop].mean(axis=0, keepdims=True)
        normal /= max(np.linalg.norm(normal), 1e-9)
        vertices = np.concatenate([vertices, vertices[loop].mean(axis=0, keepdims=True)])
        normals = np.concatenate([normals, normal])
        behind_m = np.append(behind_m, threshold_m)
        faces = np.concatenate([faces, fan])
    return _Side(vertices, faces, normals, behind_m)


def _laid_on_cloth(field: Field, side: _Side, threshold_m: float) -> Mesh:
    """The outer side in the middle of the walls, its hems moved along the gradient, smoothed."""
    vertices, faces, normals, behind_m = side
    distance = field.distances(vertices.astype(np.float32)).astype(np.float64)
    average = averaging_matrix(faces, len(vertices))
    # Both walls are equally far from the cloth but for what the field is wrong by.
    trust = np.clip((behind_m / threshold_m - 0.7) / 0.2, 0, 1)
    wrong = np.clip((distance + behind_m) / 2 - threshold_m, -threshold_m / 2, threshold_m / 2)
    wrong = blur(wrong * trust, average, _LIFT_PASSES) / np.maximum(
        blur(trust, average, _LIFT_PASSES), 1e-3
    )
    hem = np.zeros(len(vertices), dtype=bool)
    for loop in boundary_loops(faces):
        hem[loop] = True
    crest = hem | (behind_m < _CREST * threshold_m)
    _, slopes = field.gradients(vertices[crest].astype(np.float32))
    directions = normals.copy()
    directions[crest] = slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-9)
    places = vertices - (distance - wrong)[:, None] * directions
    near = crest.copy()
    for _ in range(2):
        near |= average @ near > 0
    along_hems = averaging_matrix(faces, len(vertices), along_boundaries=True)
    places = smooth(places, along_hems, np.where(hem, 0.5, 0.0), _HEM_PASSES)
    places = smooth(places, along_hems, np.where(near & ~hem, 0.9, 0.0), _NEAR_HEM_PASSES)
    places = smooth(places, along_hems, np.full(len(places), 0.5), _PASSES)
    return Mesh(places.astype(np.float32), faces.astype(np.int32))
