"""Resistance of cloth: springs along threads and diagonals, and hinges that bend."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from drapeline.geometry.mesh import edges, face_edges, triangulate
from drapeline.outfits.fabrics import Fabric

wp.set_module_options({"enable_backward": False})

# Threads along both diagonals add half of the stiffness along an edge, see `Fabric`.
_DIAGONAL_SHARE = 0.5
# Time in which damping alone would stop bending, which Blender damps as well.
_BENDING_DAMPING_S = 0.02
_SHORT_M = 1e-4
# Those of the kernels here and in `elastic_lanes`.
SHORTEST_M = wp.constant(1.0e-7)
SMALLEST_M2 = wp.constant(1.0e-12)
FLIPPED_M2 = wp.constant(1.0e-6)
_PARALLEL = 0.01  # below this squared sine of their angle, two directions span no plane
_STRAIGHT = -0.7  # cosine between two edges that follow one another along a thread


@dataclass(frozen=True)
class Springs:
    """Springs between vertices."""

    pairs: np.ndarray  # (S, 2) int, numbers of vertices
    lengths_m: np.ndarray  # (S,) at rest
    stiffness_n_m: np.ndarray  # (S,) force per change of length
    damping_kg_s: np.ndarray  # (S,) force per rate of change


@dataclass(frozen=True)
class Hinges:
    """Hinges: weighted sums of vertices, which are as far along the normal as the cloth is bent.

    The normal is along the cross product of the way from the first vertex to the second and that
    from the third to the fourth.
    """

    vertices: np.ndarray  # (H, 4) int, numbers of vertices
    weights: np.ndarray  # (H, 4), sums of zero
    # (H,) of the weighted sums along the normals, at rest; less than 0 where the cloth is bent
    # against them.
    lengths_m: np.ndarray
    stiffness_n_m: np.ndarray  # (H,) force per length
    damping_kg_s: np.ndarray  # (H,) force per rate


def make_springs(
    vertices: np.ndarray, faces: np.ndarray, fabric: Fabric, shrink: np.ndarray
) -> Springs:
    """Springs along all edges, and along both diagonals of quads.

    A spring is as stiff as the threads along it that lie in its share of the faces beside it: the
    area over its length squared (Van Gelder 1998). On square quads that is the fabric's stiffness
    along an edge and half of it along a diagonal. Triangles have no diagonals; the threads along
    those are added to their edges, so that both kinds of mesh stretch alike.

    Args:
        vertices: (V, 3) metres, at rest.
        faces: (F, 4) or (F, 3).
        shrink: (V,) share by which rest lengths are shorter than they are in `vertices`.
    """
    pairs, which = face_edges(faces)
    area = face_areas(vertices, faces)
    beside: np.ndarray = np.bincount(
        which.ravel(), np.repeat(area, faces.shape[1]), minlength=len(pairs)
    )
    if faces.shape[1] == 4:
        diagonals = np.concatenate([faces[:, [0, 2]], faces[:, [1, 3]]])
        pairs = np.concatenate([pairs, diagonals])
        beside = np.concatenate([beside / 2, area, area])
    else:
        beside = (1 + _DIAGONAL_SHARE) * beside
    lengths = _lengths(vertices[pairs[:, 0]] - vertices[pairs[:, 1]])
    share = np.maximum(beside, area.mean() / 100) / lengths**2
    return Springs(
        pairs,
        lengths * (1 - shrink[pairs].mean(axis=1)),
        share * fabric.stretch_n_per_m,
        share * fabric.damping_kg_s,
    )


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Areas (F,) in square metres of quads, as two triangles each, or of triangles."""
    return triangle_areas(vertices, triangulate(faces)).reshape(len(faces), -1).sum(axis=1)


def triangle_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Areas (F,) in square metres of triangles (F, 3)."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def make_hinges(vertices: np.ndarray, faces: np.ndarray, fabric: Fabric) -> Hinges:
    """Hinges along the threads of quads, or over the edges of triangles.

    On quads a hinge is the second difference of three vertices in a row, over the area around the
    middle one; on triangles the Laplacian of the two faces at an edge (Bergou et al. 2006, "A
    quadratic bending model"), with a third of their weight: a sheet that is rolled up bends at one
    or two of the three edges of each triangle only (Seung and Nelson 1988).

    Args:
        vertices: (V, 3) metres, at rest.
        faces: (F, 4) or (F, 3).
    """
    if faces.shape[1] == 4:
        corners, weights, scale = _thread_hinges(vertices, faces)
    else:
        corners, weights, scale = _edge_hinges(vertices, faces)
    bent = np.einsum("hk,hki->hi", weights, vertices[corners])
    lengths = (bent * _hinge_normals(vertices, corners)).sum(axis=1)
    bending = fabric.bending_n_m * scale
    return Hinges(corners, weights, lengths, bending, _BENDING_DAMPING_S * bending)


def _hinge_normals(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Unit normals (H, 3) of hinges; zero where there is none."""
    a, b, c, d = (vertices[corners[:, k]] for k in range(4))
    normals = np.cross(b - a, d - c)
    return normals / (np.linalg.norm(normals, axis=1, keepdims=True) + SMALLEST_M2)


def _thread_hinges(
    vertices: np.ndarray, quads: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (H, 4), weights (H, 4) and area / length^4 (H,) of hinges along threads.

    A hinge is of three vertices in a row, and one beside the middle.

    Where rows turn within the cloth, the weights take out what the second difference has in its
    plane.
    """
    first, middle, last, beside = _rows_of_three(vertices, quads).T
    ways = [vertices[end] - vertices[middle] for end in (first, last, beside)]
    before, after = (_lengths(way) for way in ways[:2])
    length = (before + after) / 2
    corners = np.stack([first, last, middle, beside], axis=1)
    normals = _hinge_normals(vertices, corners)
    to_first, to_last, aside = (w - (w * normals).sum(1)[:, None] * normals for w in ways)
    to_first, to_last = to_first / before[:, None], to_last / after[:, None]
    share, off = _solve_pairs((to_last - to_first) / 2, aside / length[:, None], to_first + to_last)
    ahead, behind = length * (1 + share / 2) / before, length * (1 - share / 2) / after
    weights = np.stack([ahead, behind, off - ahead - behind, -off], axis=1)
    areas = face_areas(vertices, quads)
    area = np.bincount(quads.ravel(), np.repeat(areas / 4, 4), minlength=len(vertices))
    return corners, weights, np.maximum(area[middle], areas.mean() / 100) / length**4


def _solve_pairs(
    one: np.ndarray, two: np.ndarray, sums: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers a and b (N,) of which a one + b two is closest to `sums`; all of these are (N, 3)."""
    squares = (one**2).sum(1), (one * two).sum(1), (two**2).sum(1)
    right = (one * sums).sum(1), (two * sums).sum(1)
    determinant = squares[0] * squares[2] - squares[1] ** 2
    apart = determinant > _PARALLEL * squares[0] * squares[2]
    determinant = np.where(apart, determinant, 1)
    a = (squares[2] * right[0] - squares[1] * right[1]) / determinant
    b = (squares[0] * right[1] - squares[1] * right[0]) / determinant
    return np.where(apart, a, 0), np.where(apart, b, 0)


def _rows_of_three(vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Vertices (R, 4): three in a row, and one beside the middle one.

    No face has all of the first three; the fourth is in one with the first two.
    """
    pairs = edges(quads).astype(np.int64)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first_edge = np.searchsorted(both[:, 0], np.arange(len(vertices) + 1))
    count = np.diff(first_edge)
    rows = []
    for one in range(count.max()):
        for two in range(one + 1, count.max()):
            middle = np.flatnonzero(count > two)
            start = first_edge[middle]
            rows.append(np.stack([both[start + one, 1], middle, both[start + two, 1]], axis=1))
    row = np.concatenate(rows)
    before, middle, after = (np.roll(quads, k, axis=1).ravel().astype(np.int64) for k in (1, 0, -1))
    size = len(vertices)
    corner = (middle * size + np.minimum(before, after)) * size + np.maximum(before, after)
    key = (row[:, 1] * size + row[:, 0]) * size + row[:, 2]
    row = row[~np.isin(key, corner)]
    one = vertices[row[:, 0]] - vertices[row[:, 1]]
    two = vertices[row[:, 2]] - vertices[row[:, 1]]
    cosine = (one * two).sum(1) / (_lengths(one) * _lengths(two))
    row = row[cosine < _STRAIGHT]
    # A face's corner at the middle has the first before it or after it; the other is beside.
    keys = np.concatenate([middle * size + before, middle * size + after])
    others = np.concatenate([after, before])
    order = np.argsort(keys, kind="stable")
    place = np.searchsorted(keys[order], row[:, 1] * size + row[:, 0])
    return np.column_stack([row, others[order][place]])


def _edge_hinges(
    vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hinges over edges of two triangles: corners (H, 4), weights (H, 4), 1 / area (H,)."""
    _, which = face_edges(triangles)
    flat = which.ravel()
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(flat[order][1:] == flat[order][:-1])
    one, two = order[same], order[same + 1]  # half edges, three per face
    start = triangles.ravel()[one]
    end = np.roll(triangles, -1, axis=1).ravel()[one]
    far = np.roll(triangles, -2, axis=1).ravel()
    corners = np.stack([start, end, far[one], far[two]], axis=1)
    x0, x1, x2, x3 = (vertices[corners[:, k]] for k in range(4))
    at_start = (_cotangent(x1, x2, x0), _cotangent(x1, x3, x0))
    at_end = (_cotangent(x0, x2, x1), _cotangent(x0, x3, x1))
    weights = np.stack(
        [
            at_end[0] + at_end[1],
            at_start[0] + at_start[1],
            -at_start[0] - at_end[0],
            -at_start[1] - at_end[1],
        ],
        axis=1,
    )
    area = np.maximum(triangle_areas(vertices, triangles), _SHORT_M**2)
    return corners, weights, 1 / (area[one // 3] + area[two // 3])


def _cotangent(a: np.ndarray, b: np.ndarray, apex: np.ndarray) -> np.ndarray:
    """Cotangents (N,) of the angles at `apex` between `a` and `b`."""
    one, two = a - apex, b - apex
    return (one * two).sum(1) / _lengths(np.cross(one, two), least=_SHORT_M**2)


def _lengths(ways: np.ndarray, least: float = _SHORT_M) -> np.ndarray:
    """Lengths (N,) of vectors (N, 3), but never zero: a mesh may have edges without length."""
    return np.maximum(np.linalg.norm(ways, axis=1), least)


def spring_numbers(springs: Springs, inverse_masses: np.ndarray, step_s: float) -> np.ndarray:
    """Numbers (S, 4) that springs are pulled with.

    Lengths at rest, compliance over step^2, compliance times damping over step, and push per metre
    that is missing.
    """
    masses = inverse_masses[springs.pairs].sum(axis=1)
    compliance, damping, ease = _responses(springs, masses, step_s)
    return np.stack([springs.lengths_m, compliance, damping, ease], axis=1)


def hinge_numbers(hinges: Hinges, inverse_masses: np.ndarray, step_s: float) -> np.ndarray:
    """Numbers (H, 4) that hinges are turned with.

    Lengths at rest, how far a push bends them, compliance times damping over step, and push per
    metre that is missing.
    """
    masses = (inverse_masses[hinges.vertices] * hinges.weights**2).sum(axis=1)
    _, damping, ease = _responses(hinges, masses, step_s)
    return np.stack([hinges.lengths_m, masses, damping, ease], axis=1)


def _responses(
    constraints: Springs | Hinges, masses: np.ndarray, step_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compliance, damping and ease of constraints by the inverse masses (C,) that they act on.

    Macklin et al. 2016, "XPBD", equations 18 and 26.
    """
    compliance = 1 / constraints.stiffness_n_m
    damping = compliance * constraints.damping_kg_s / step_s
    compliance = compliance / step_s**2
    return compliance, damping, 1 / ((1 + damping) * masses + compliance)


@wp.func
def _place(weighed: wp.vec4):
    return wp.vec3(weighed[0], weighed[1], weighed[2])


@wp.func
def _moved(weighed: wp.vec4, way: wp.vec3):
    return weighed + wp.vec4(way[0], way[1], way[2], 0.0)


@wp.kernel
def pull_springs(
    ends: wp.array2d[int],
    numbers: wp.array2d[float],  # see `spring_numbers`
    first: int,  # spring
    begins: int,
    finishes: int,  # the sweeps of a small step
    share: float,  # of the way to where it is content
    pull: wp.array[float],  # of the sweeps before in this step
    lengths: wp.array[float],  # of springs when they had last been pulled, the step before
    weighed: wp.array[wp.vec4],  # place and inverse mass
):
    """Pull or push the ends of springs towards their lengths at rest."""
    spring = first + wp.tid()
    i = ends[spring, 0]
    j = ends[spring, 1]
    a = weighed[i]
    b = weighed[j]
    way = _place(a) - _place(b)
    # Never 0, so that what has no length has no direction, instead of NaN.
    length = wp.length(way) + SHORTEST_M
    push = numbers[spring, 0] - length - numbers[spring, 2] * (length - lengths[spring])
    if begins == 0:
        push -= numbers[spring, 1] * pull[spring]
    push *= share * numbers[spring, 3]
    if begins == 0:
        pull[spring] = pull[spring] + push
    else:
        pull[spring] = push
    if finishes != 0:
        lengths[spring] = length + push * (a[3] + b[3])
    way *= push / length
    weighed[i] = _moved(a, way * a[3])
    weighed[j] = _moved(b, -way * b[3])


@wp.kernel
def turn_hinges(
    corners: wp.array2d[int],
    weights: wp.array2d[float],
    numbers: wp.array2d[float],  # see `hinge_numbers`
    first: int,  # hinge
    turned: wp.array[float],  # how far hinges were bent when they had last been turned
    weighed: wp.array[wp.vec4],  # place and inverse mass
):
    """Turn hinges towards their angles at rest."""
    hinge = first + wp.tid()
    a = _place(weighed[corners[hinge, 0]])
    b = _place(weighed[corners[hinge, 1]])
    c = _place(weighed[corners[hinge, 2]])
    d = _place(weighed[corners[hinge, 3]])
    normal = wp.cross(b - a, d - c)
    size = wp.length(normal) + SMALLEST_M2
    total = a * weights[hinge, 0] + b * weights[hinge, 1]
    total += c * weights[hinge, 2] + d * weights[hinge, 3]
    bent = wp.dot(normal, total) / size
    rate = bent - turned[hinge]
    if bent * turned[hinge] < -FLIPPED_M2:
        # From far on one side to far on the other: it is folded flat, and its normal has flipped.
        rate = 0.0
    push = (numbers[hinge, 0] - bent - numbers[hinge, 2] * rate) * numbers[hinge, 3]
    turned[hinge] = bent + push * numbers[hinge, 1]
    for k in range(4):
        i = corners[hinge, k]
        vertex = weighed[i]
        weighed[i] = _moved(vertex, normal * (push / size * weights[hinge, k] * vertex[3]))


@wp.kernel
def measure_strain(
    pairs: wp.array[wp.vec2i],
    rest_lengths: wp.array[float],
    place: wp.array[wp.vec3],
    strain: wp.array[float],
):
    """Largest length over length at rest of the springs at each vertex."""
    spring = wp.tid()
    i = pairs[spring][0]
    j = pairs[spring][1]
    stretch = wp.length(place[i] - place[j]) / rest_lengths[spring]
    wp.atomic_max(strain, i, stretch)
    wp.atomic_max(strain, j, stretch)
