"""The open, single surface of a garment in the middle between the two walls around it.

SMPLicit (Corona et al. 2021) ends with the walls of `walls.extract_walls`; this step is
ours. Which wall is the outer one is a segmentation of the walls' closed surface: as in a minimum
cut (Greig et al. 1989, Boykov et al. 2001) each place has an opinion of its own, and the border
goes where it is cheap. We solve the relaxed problem, a random walker (Grady 2006), since its border
passes through triangles, not along their zigzag edges. The outer wall is then brought onto the
cloth, along the walls' normals and, at its hems, along the field's gradients as in NDF (Chibane et
al. 2020). MeshUDF (Guillard et al. 2022) also extracts open surfaces from such fields; it needs
gradients at all points of a grid, most of them next to the cloth, where they are least certain.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import cg

from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, boundary_edges, boundary_loops, edges, face_normals
from drapeline.geometry.smoothing import averaging_matrix, blur, smooth
from drapeline.metrics.garment import piece_indices
from drapeline.models.smplicit.garments import Box
from drapeline.models.smplicit.settings import Meshing
from drapeline.models.smplicit.surface.fields import DistanceField, NearBody
from drapeline.models.smplicit.surface.walls import Grid, extract_walls

SMALLEST_OPENING_M = 0.2  # around; sleeves have 0.3 m
_SMALLEST_PIECE = 0.1  # of the largest one's number of vertices
# How sides are told apart.
_AGREEMENT_EDGES = 10.0  # how far vertices on the same wall help each other, in edges
_RIM_POWER = 6  # of what the probe says, so that even slanting parts of a rim part the walls
_RIM_TIE = 1e-3  # of two vertices on a rim, as a share of that on a wall
_TOLERANCE = 1e-3
# Around hems, in edges from them.
_HEM_REACH, _BLUR_PASSES = 2, 8
_WALL_SHARE = 0.8  # of the threshold, which the probe finds where a rim has become a wall
_HEM_PASSES, _SPREAD_PASSES, _LAST_PASSES = 10, 10, 3
_REPAIRS = 5


def extract_sheet(
    field: DistanceField, walls: Mesh, threshold_m: float, outward: np.ndarray
) -> Mesh:
    """The open surface that walls at a distance `threshold_m` surround.

    Most places take two or three distances and no gradient. Openings closer together than twice
    the threshold have grown together in the walls, and stay so.

    Args:
        field: distances, which may be off by a little that changes slowly from place to place.
        walls: of `extract_walls`.
        threshold_m: the same.
        outward: (V, 3) for each of the walls' vertices, roughly the way out: away from the body.
            Where garments touch the body, its normal at the closest point errs less than the way
            from there.

    Returns:
        Triangles, counter-clockwise seen from outside; its loops are at least as long as
        `SMALLEST_OPENING_M`, and small loose pieces are left out. No faces if no wall looks
        outwards.
    """
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    if not len(walls.faces):
        return none
    normals, areas = _normals(walls)
    through = field.distances(_move(walls.vertices, normals, -2 * threshold_m))
    side = _sides(walls, areas, through / threshold_m, (normals * outward).sum(axis=1))
    faces, lift = _cut(walls.faces, side)
    if not len(faces):
        return none
    faces, lift = _large_pieces(faces, lift)
    faces, lift = _fill(faces, lift, walls.vertices)
    outer = _Outer(
        faces,
        lift @ walls.vertices.astype(np.float64),
        _unit(lift @ normals),
        lift @ through.astype(np.float64),
    )
    return Mesh(_relax(outer, *_place(field, outer, threshold_m)), faces.astype(np.int32))


class _Outer(NamedTuple):
    """The outer wall: faces, vertices (V, 3), normals (V, 3), distances behind (V,)."""

    faces: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray
    through: np.ndarray


def _normals(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (V, 3) and areas (V,), up to a factor, of the faces around vertices."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    cross = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    corner = mesh.faces.ravel()
    count = len(mesh.vertices)
    sums = np.stack([np.bincount(corner, cross[:, k], count) for k in range(3)], axis=1)
    return _unit(sums), np.linalg.norm(sums, axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-20)


def _move(points: np.ndarray, ways: np.ndarray, length: np.ndarray | float) -> np.ndarray:
    return (points + length * ways).astype(np.float32)


def _sides(walls: Mesh, areas: np.ndarray, through: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """(V,) positive on the outer wall, negative on the inner.

    Minimises, over vertices i and edges ij, sum a_i (u_i - facing_i)^2 + sum w_ij (u_i - u_j)^2.
    From a wall, one threshold leads to the cloth and another to the wall behind it: the probe
    `through`, a distance in thresholds, is 1. On a rim the same way leads into the cloth, where the
    distance is the sine of the angle that one has gone around the rim: 0 halfway, where the border
    is to be.
    """
    pairs = edges(walls.faces)
    count = len(walls.vertices)
    wall = np.clip(through, 0, 1)[pairs].min(axis=1)
    tie = _AGREEMENT_EDGES**2 * np.maximum(wall**_RIM_POWER, _RIM_TIE)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    ties = sp.csr_matrix((np.tile(tie, 2), ends.T), (count, count))
    weight = areas / areas.mean()
    diagonal = weight + np.asarray(ties.sum(axis=1)).ravel()
    system = sp.diags(diagonal, format="csr") - ties
    jacobi = sp.diags(1 / np.maximum(diagonal, 1e-20))
    side, _ = cg(system, weight * facing, x0=facing, rtol=_TOLERANCE, M=jacobi)
    return side


def _cut(faces: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, sp.csr_matrix]:
    """The part of a mesh on the positive side, cut off through the triangles.

    Returns:
        Faces (F', 3), and the matrix (V', V) that takes values at the mesh's vertices to the
        part's.
    """
    count = len(side)
    inside = side > 0
    corners = inside[faces].sum(axis=1)
    one, two = (
        np.take_along_axis(f, ((inside[f] == k).argmax(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
        for f, k in ((faces[corners == 1], True), (faces[corners == 2], False))
    )
    # Edges that are cut, from inside to outside.
    cut = np.concatenate([one[:, [0, 1]], one[:, [0, 2]], two[:, [1, 0]], two[:, [2, 0]]])
    key, new = np.unique(cut[:, 0].astype(np.int64) * count + cut[:, 1], return_inverse=True)
    first, second, third, fourth = np.split(count + new, np.cumsum([len(one), len(one), len(two)]))
    parts = [
        faces[corners == 3],
        np.stack([one[:, 0], first, second], axis=1),
        np.stack([two[:, 1], two[:, 2], fourth], axis=1),
        np.stack([two[:, 1], fourth, third], axis=1),
    ]
    start, end = np.divmod(key, count)
    # New vertices keep off the old ones, for triangles with some area.
    share = np.clip(side[start] / (side[start] - side[end]), 0.05, 0.95)
    row = count + np.tile(np.arange(len(key)), 2)
    lift = sp.csr_matrix(
        (
            np.concatenate([np.ones(count), 1 - share, share]),
            (
                np.concatenate([np.arange(count), row]),
                np.concatenate([np.arange(count), start, end]),
            ),
        ),
        (count + len(key), count),
    )
    return _compact(np.concatenate(parts), lift)


def _compact(faces: np.ndarray, lift: sp.csr_matrix) -> tuple[np.ndarray, sp.csr_matrix]:
    """Without rows for vertices in no face."""
    used, corners = np.unique(faces, return_inverse=True)
    return corners.reshape(faces.shape), lift[used]


def _large_pieces(faces: np.ndarray, lift: sp.csr_matrix) -> tuple[np.ndarray, sp.csr_matrix]:
    piece = piece_indices(Mesh(np.zeros((lift.shape[0], 3)), faces))
    sizes = np.bincount(piece)
    return _compact(faces[(sizes >= _SMALLEST_PIECE * sizes[0])[piece[faces[:, 0]]]], lift)


def _fill(
    faces: np.ndarray, lift: sp.csr_matrix, vertices: np.ndarray
) -> tuple[np.ndarray, sp.csr_matrix]:
    """Close loops that are shorter than any opening, with a vertex in the middle of each.

    Loops that touch one another are left, since it is open which way each of them goes on.
    """
    places = lift @ vertices
    try:
        loops = boundary_loops(faces)
    except ValueError:
        return faces, lift
    for loop in loops:
        sides = places[loop] - places[np.roll(loop, 1)]
        if np.linalg.norm(sides, axis=1).sum() < SMALLEST_OPENING_M:
            middle = np.full(len(loop), lift.shape[0])
            faces = np.concatenate([faces, np.stack([np.roll(loop, -1), loop, middle], axis=1)])
            lift = sp.vstack([lift, sp.csr_matrix(lift[loop].mean(axis=0))], format="csr")
    return faces, lift


def _place(
    field: DistanceField, outer: _Outer, threshold_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of the outer wall's vertices on the cloth.

    A field that is off by e has its walls at distances threshold - e. Along the normal of a wall
    with distance d before and b behind, two thresholds further, both lie on flanks of the same
    valley, which gives e = (d + b) / 2 - threshold. Unlike the field at the bottom of the valley,
    where networks round it off, that tells its place.

    Returns:
        Places (V, 3), which vertices lie on hems (V,), and which around them the way to the cloth
        leads to the hem as well (V,).
    """
    count = len(outer.vertices)
    average = averaging_matrix(outer.faces, count)
    hem = np.zeros(count, dtype=bool)
    hem[boundary_edges(outer.faces)] = True
    near = _widen(hem, average, _HEM_REACH)
    rim = hem | (near & (outer.through < _WALL_SHARE * threshold_m))
    distance = field.distances(outer.vertices.astype(np.float32)).astype(np.float64)
    half = threshold_m / 2
    error = np.clip((distance + outer.through) / 2 - threshold_m, -half, half)
    known = np.where(near, 0.0, 1.0)
    sums, shares = blur(np.stack([known * error, known], axis=1), average, _BLUR_PASSES).T
    error = sums / np.maximum(shares, 1e-3)
    ways = outer.normals.copy()
    ways[rim] = _unit(field.gradients(outer.vertices[rim].astype(np.float32))[1])
    return outer.vertices - (distance - error)[:, None] * ways, hem, rim


def _widen(mask: np.ndarray, average: sp.csr_matrix, edges_wide: int) -> np.ndarray:
    """A mask of vertices and all that are at most so many edges away."""
    for _ in range(edges_wide):
        mask = mask | (average @ mask > 0)
    return mask


def _relax(outer: _Outer, places: np.ndarray, hem: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) float32: hems smoothed along themselves, all else a little."""
    average = averaging_matrix(outer.faces, len(places), along_boundaries=True)
    around = _widen(rim, average, _HEM_REACH) & ~hem
    places = smooth(places, average, 0.5 * hem, _HEM_PASSES)
    places = smooth(places, average, 0.9 * around, _SPREAD_PASSES)
    places = smooth(places, average, np.full(len(places), 0.5), _LAST_PASSES)
    for _ in range(_REPAIRS):
        turned = _turned(places, outer.faces)
        if not turned.any():
            break
        moved = np.zeros(len(places), dtype=bool)
        moved[outer.faces[turned]] = True
        places = smooth(places, average, 0.5 * _widen(moved, average, 1), _SPREAD_PASSES)
    return places.astype(np.float32)


def _turned(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F,) faces that look away from the surface around them."""
    around = _normals(Mesh(vertices, faces))[0][faces].sum(axis=1)
    return (face_normals(vertices, faces) * around).sum(axis=1) < 0


class FieldGarment(NamedTuple):
    """A garment of a code on a body at rest.

    Attributes:
        sheet: one layer, open at the garment's openings; no faces if nothing is left of it.
        walls: the closed surface of the paper, on both sides of the cloth.
    """

    sheet: Mesh
    walls: Mesh


def garment_of_field(field: DistanceField, box: Box, body: Mesh, meshing: Meshing) -> FieldGarment:
    """Walls and sheet of a field in a box, its corners in metres, on a body at rest, triangles."""
    low, high = np.asarray(box)
    near = NearBody(field, box, body.vertices)
    walls = extract_walls(near, Grid(low, high, meshing.cell_m), meshing.threshold_m)
    outward = away_from_body(walls.vertices, body)
    return FieldGarment(extract_sheet(field, walls, meshing.threshold_m, outward), walls)


def away_from_body(points: np.ndarray, body: Mesh) -> np.ndarray:
    """(P, 3) normals of the body's nearest faces."""
    _, face = closest_points(points, body.vertices, body.faces)
    return face_normals(body.vertices, body.faces[face])
