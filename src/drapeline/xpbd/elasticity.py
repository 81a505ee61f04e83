"""Resistance of cloth: springs along threads and diagonals, and hinges that bend."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from drapeline.geometry.mesh import edges, face_edges, triangulate
from drapeline.outfits.fabrics import Fabric
from drapeline.xpbd.threads import weft_directions

wp.set_module_options({"enable_backward": False})

_LEFT = 0.1  # least share of a thread's stiffness that is not left to the diagonals
_LEAST_N_PER_M = 1.0  # of any spring
_ELASTIC_N_PER_M = 200.0  # a band that gathers a sleeve, leg or waist
_SHEAR_WEIGHT = 0.1  # of the shear of triangles beside what they resist along the threads
_DESCENTS = 40
# Time in which damping alone would stop bending, which Blender damps as well.
_BENDING_DAMPING_S = 0.02
# More, and springs that are solved three times in a step would throw their neighbours about.
_MOST_DAMPING = 0.5
# Of a hinge's masses; with less, stiff cloth trembles.
_LEAST_COMPLIANCE = 0.3
_SHORT_M = 1e-4
# Those of the kernels here and in `elastic_lanes`.
SHORTEST_M = wp.constant(1.0e-7)
SMALLEST_M2 = wp.constant(1.0e-12)
FLIPPED_M2 = wp.constant(1.0e-6)
_PARALLEL = 0.01  # below this squared sine of their angle, two directions span no plane
_MOST_COTANGENT = 5.0  # of slivers, which would turn fast under the least force
_STRAIGHT = -0.7  # cosine between two edges that follow one another along a thread


@dataclass(frozen=True)
class Springs:
    """Springs between vertices."""

    pairs: np.ndarray  # (S, 2) int, numbers of vertices
    lengths_m: np.ndarray  # (S,) at rest
    stiffness_n_m: np.ndarray  # (S,) force per length by which they are stretched
    pushed_n_m: np.ndarray  # (S,) force per length by which they are compressed
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
    vertices: np.ndarray,
    faces: np.ndarray,
    fabric: Fabric,
    shrink: np.ndarray,
    warp: np.ndarray,
) -> Springs:
    """Springs along all edges, and along both diagonals of quads.

    A spring is as stiff as the threads along it that lie in its share of the faces beside it: the
    area over its length squared (Van Gelder 1998). On quads edges are threads of the warp or of the
    weft, and the diagonals have the fabric's shear stiffness; what these add along the threads is
    taken from the edges. Triangles have the fabric's stiffness along both threads, and shear as
    little as three springs can.

    Args:
        vertices: (V, 3) metres, at rest.
        faces: (F, 4) or (F, 3).
        shrink: (V,) share by which rest lengths are shorter than they are in `vertices`; threads
            that an elastic gathers are no stiffer than it.
        warp: (F, 3), see `threads.warp_directions`.
    """
    pairs, which = face_edges(faces)
    count = len(pairs)
    tensions, pushes = _face_tensions(vertices, faces, fabric, warp)
    area = np.repeat(face_areas(vertices, faces)[:, None], tensions.shape[1], axis=1)
    if faces.shape[1] == 4:
        pairs = np.concatenate([pairs, faces[:, [0, 2]], faces[:, [1, 3]]])
        diagonals = count + np.arange(2 * len(faces)).reshape(2, -1).T
        which = np.concatenate([which, diagonals], axis=1)
        area[:, :4] /= 2
    lengths = _lengths(vertices[pairs[:, 0]] - vertices[pairs[:, 1]])
    beside, stretched, pushed = (
        np.bincount(which.ravel(), weights.ravel(), minlength=len(pairs))
        for weights in (area, area * tensions, area * pushes)
    )
    share = np.maximum(beside, area.mean() / 100) / lengths**2
    stretched, pushed = (
        np.maximum(sums / np.maximum(beside, _SHORT_M**3), _LEAST_N_PER_M)
        for sums in (stretched, pushed)
    )
    gathered = shrink[pairs].mean(axis=1)
    stretched = np.where(gathered > 0, np.minimum(stretched, _ELASTIC_N_PER_M), stretched)
    # As slow as the threads are to follow a pull.
    slow_s = fabric.damping_kg_s / fabric.stretch_n_per_m
    return Springs(
        pairs,
        lengths * (1 - gathered),
        share * stretched,
        share * np.minimum(stretched, pushed),
        share * stretched * slow_s,
    )


def _face_tensions(
    vertices: np.ndarray, faces: np.ndarray, fabric: Fabric, warp: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Tension per width and strain (F, K) along each face's edges, and a quad's diagonals.

    The second is that of what is compressed.
    """
    if faces.shape[1] == 4:
        return _quad_tensions(vertices[faces], warp, fabric)
    weft = weft_directions(vertices, faces, warp)
    sides = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]
    sides /= _lengths(sides.reshape(-1, 3)).reshape(-1, 3, 1)
    along, across = ((sides @ way[:, :, None])[..., 0] ** 2 for way in (warp, weft))
    tensions = _triangle_tensions(along, across, fabric)
    return tensions, np.minimum(tensions, fabric.compression_n_per_m)


def _quad_tensions(
    corners: np.ndarray, warp: np.ndarray, fabric: Fabric
) -> tuple[np.ndarray, np.ndarray]:
    """Tensions (F, 6) along the edges and diagonals of quads (F, 4, 3), as `_face_tensions`.

    Of sheared cloth one diagonal is stretched and the other compressed, which together have the
    shear stiffness. Diagonals that resisted both alike would keep quads level: cloth that is as
    stiff along its threads could not curve two ways.
    """
    a, b, c, d = np.moveaxis(corners, 1, 0)
    one, two = (b - a + c - d) / 2, (d - a + c - b) / 2
    longer = np.clip((one**2).sum(1) / np.maximum((two**2).sum(1), _SHORT_M**2), 0.25, 4)
    first, second = (abs((way * warp).sum(1)) / _lengths(way) for way in (one, two))
    stiff = np.array([fabric.stretch_weft_n_per_m, fabric.stretch_warp_n_per_m])
    pushed = min((fabric.compression_n_per_m / fabric.stretch_n_per_m) ** 2, 1)
    shear = (2 - pushed) * fabric.shear_n_per_m
    of_one, of_two = stiff[(first >= second).astype(int)], stiff[(first < second).astype(int)]
    of_one = np.maximum(of_one - shear * longer, _LEFT * of_one)
    of_two = np.maximum(of_two - shear / longer, _LEFT * of_two)
    across = fabric.shear_n_per_m * (1 + longer) ** 2 / (2 * longer)
    threads = np.stack([of_one, of_two, of_one, of_two], axis=1)
    diagonals = np.stack([across, across], axis=1)
    return (
        np.concatenate([threads, (2 - pushed) * diagonals], axis=1),
        np.concatenate(
            [np.minimum(threads, fabric.compression_n_per_m), pushed * diagonals], axis=1
        ),
    )


def _triangle_tensions(along: np.ndarray, across: np.ndarray, fabric: Fabric) -> np.ndarray:
    """Tensions (F, 3) along edges whose squared cosines with warp and weft are (F, 3) each.

    The least squares, none less than 0, of what three springs add up to: the stiffness along both
    threads, and with a small weight the shear.
    """
    stiff = np.array([fabric.stretch_warp_n_per_m, fabric.stretch_weft_n_per_m])
    typical = fabric.stretch_n_per_m
    rows = np.stack(
        [
            along**2 * typical / stiff[0],
            across**2 * typical / stiff[1],
            _SHEAR_WEIGHT * along * across,
        ],
        axis=1,
    )
    goal = np.array([1, 1, _SHEAR_WEIGHT * fabric.shear_n_per_m / typical])
    square, right = np.swapaxes(rows, 1, 2) @ rows, rows.transpose(0, 2, 1) @ goal
    shares = np.full(along.shape, 1.0)
    for _ in range(_DESCENTS):
        for k in range(3):
            excess = (square[:, k] * shares).sum(1) - right[:, k]
            least = np.maximum(square[:, k, k], 1e-6)
            shares[:, k] = np.maximum(shares[:, k] - excess / least, 0)
    return shares * typical


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Areas (F,) in square metres of quads, as two triangles each, or of triangles."""
    return triangle_areas(vertices, triangulate(faces)).reshape(len(faces), -1).sum(axis=1)


def triangle_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Areas (F,) in square metres of triangles (F, 3)."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def make_hinges(
    vertices: np.ndarray,
    faces: np.ndarray,
    fabric: Fabric,
    warp: np.ndarray,
    stiffness: np.ndarray,
) -> Hinges:
    """Hinges along the threads of quads and across them, or over the edges of triangles.

    On quads a hinge is the second difference of three vertices in a row, over the area around the
    middle one, or what one diagonal lies above the other: cloth that is twisted resists as much as
    between warp and weft, so that it is as stiff on the bias. On triangles it is the Laplacian of
    the two faces at an edge (Bergou et al. 2006, "A quadratic bending model"), with a third of
    their weight: a sheet that is rolled up bends at one or two of the three edges of each triangle
    only (Seung and Nelson 1988).

    Args:
        vertices: (V, 3) metres, at rest.
        faces: (F, 4) or (F, 3).
        warp: (F, 3), see `threads.warp_directions`.
        stiffness: (V,) how many times as stiff as the fabric; a hinge has the mean of its vertices.
    """
    weft = weft_directions(vertices, faces, warp)
    kind = _thread_hinges if faces.shape[1] == 4 else _edge_hinges
    corners, weights, scale, way, face = kind(vertices, faces)
    ways = [(way * threads[face]).sum(1) for threads in (warp, weft)]
    squares = np.stack(ways, axis=1) ** 2 + SMALLEST_M2
    if faces.shape[1] == 4:
        squares = (squares >= squares.max(axis=1, keepdims=True)).astype(float)
    squares /= squares.sum(axis=1, keepdims=True)
    bending = squares @ [fabric.bending_warp_n_m, fabric.bending_weft_n_m] * scale
    if faces.shape[1] == 4:
        twisted = 2 * fabric.bending_n_m
        area = np.maximum(face_areas(vertices, faces), _SHORT_M**2)
        corners = np.concatenate([corners, faces[:, [0, 2, 1, 3]]])
        weights = np.concatenate([weights, _twist_weights(vertices[faces])])
        bending = np.concatenate([bending, twisted / area])
    bending = bending * stiffness[corners].mean(axis=1)
    bent = np.einsum("hk,hki->hi", weights, vertices[corners])
    lengths = (bent * _hinge_normals(vertices, corners)).sum(axis=1)
    return Hinges(corners, weights, lengths, bending, _BENDING_DAMPING_S * bending)


def _twist_weights(corners: np.ndarray) -> np.ndarray:
    """Weights (F, 4) of corners 0, 2, 1 and 3 of quads (F, 4, 3), 1 and -1 on parallelograms.

    Their sum is along the normal, and 0 where the quad is level.
    """
    a, b, c, d = np.moveaxis(corners, 1, 0)
    normals = np.cross(c - a, d - b)
    areas = [
        (np.cross(two - one, three - one) * normals).sum(1)
        for one, two, three in ((b, c, d), (a, b, d), (a, c, d), (a, b, c))
    ]
    weights = np.stack(areas, axis=1) * [1, 1, -1, -1]
    size = abs(weights).mean(axis=1, keepdims=True)
    return np.where(size > 0, weights / np.where(size > 0, size, 1), 0)


def _hinge_normals(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Unit normals (H, 3) of hinges; zero where there is none."""
    a, b, c, d = (vertices[corners[:, k]] for k in range(4))
    normals = np.cross(b - a, d - c)
    return normals / (np.linalg.norm(normals, axis=1, keepdims=True) + SMALLEST_M2)


_Hinges = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _thread_hinges(vertices: np.ndarray, quads: np.ndarray) -> _Hinges:
    """Hinges along threads: three vertices in a row, and one beside the middle.

    Corners (H, 4), weights (H, 4), area / length^4 (H,), the way (H, 3) in which the cloth is bent,
    and the number (H,) of a face there.

    Where rows turn within the cloth, the weights take out what the second difference has in its
    plane.
    """
    rows, face = _rows_of_three(vertices, quads)
    first, middle, last, beside = rows.T
    ways = [vertices[end] - vertices[middle] for end in (first, last, beside)]
    before, after = (_lengths(way) for way in ways[:2])
    length = (before + after) / 2
    corners = np.stack([first, last, middle, beside], axis=1)
    normals = _hinge_normals(vertices, corners)
    to_first, to_last, aside = (w - (w * normals).sum(1)[:, None] * normals for w in ways)
    to_first, to_last = to_first / before[:, None], to_last / after[:, None]
    share, off = _solve_pairs((to_last - to_first) / 2, aside / length[:, None], to_first + to_last)
    share, off = np.clip(share, -1, 1), np.clip(off, -2, 2)
    ahead, behind = length * (1 + share / 2) / before, length * (1 - share / 2) / after
    weights = np.stack([ahead, behind, off - ahead - behind, -off], axis=1)
    areas = face_areas(vertices, quads)
    area = np.bincount(quads.ravel(), np.repeat(areas / 4, 4), minlength=len(vertices))
    scale = np.maximum(area[middle], areas.mean() / 100) / length**4
    return corners, weights, scale, to_last - to_first, face


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


def _rows_of_three(vertices: np.ndarray, quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (R, 4), three in a row and one beside the middle one, and numbers (R,) of faces.

    No face has all of the first three; the fourth is in one with the first two, which is numbered.
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
    place = order[np.searchsorted(keys[order], row[:, 1] * size + row[:, 0])]
    return np.column_stack([row, others[place]]), place % quads.size // 4


def _edge_hinges(vertices: np.ndarray, triangles: np.ndarray) -> _Hinges:
    """Hinges over edges of two triangles, as `_thread_hinges` but for the scale, 1 / area (H,)."""
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
    edge = (x1 - x0) / _lengths(x1 - x0)[:, None]
    across = x3 - x2 - ((x3 - x2) * edge).sum(1)[:, None] * edge
    return corners, weights, 1 / (area[one // 3] + area[two // 3]), across, one // 3


def _cotangent(a: np.ndarray, b: np.ndarray, apex: np.ndarray) -> np.ndarray:
    """Cotangents (N,) of the angles at `apex` between `a` and `b`."""
    one, two = a - apex, b - apex
    cotangents = (one * two).sum(1) / _lengths(np.cross(one, two), least=_SHORT_M**2)
    return np.clip(cotangents, -_MOST_COTANGENT, _MOST_COTANGENT)


def _lengths(ways: np.ndarray, least: float = _SHORT_M) -> np.ndarray:
    """Lengths (N,) of vectors (N, 3), but never zero: a mesh may have edges without length."""
    return np.maximum(np.linalg.norm(ways, axis=1), least)


def spring_numbers(springs: Springs, inverse_masses: np.ndarray, step_s: float) -> np.ndarray:
    """Numbers (S, 6) that springs are pulled with.

    Lengths at rest; compliance over step^2 and push per metre that is missing, of what is
    stretched and then of what is compressed; compliance times damping over step.
    """
    masses = inverse_masses[springs.pairs].sum(axis=1)
    compliance, damping, ease = _responses(springs, masses, step_s, _MOST_DAMPING)
    pushed = 1 / springs.pushed_n_m / step_s**2
    pushed_ease = 1 / ((1 + damping) * masses + pushed)
    return np.stack([springs.lengths_m, compliance, ease, pushed, pushed_ease, damping], axis=1)


def hinge_numbers(hinges: Hinges, inverse_masses: np.ndarray, step_s: float) -> np.ndarray:
    """Numbers (H, 4) that hinges are turned with.

    Lengths at rest, how far a push bends them, compliance times damping over step, and push per
    metre that is missing.
    """
    masses = (inverse_masses[hinges.vertices] * hinges.weights**2).sum(axis=1)
    compliance, damping, _ = _responses(hinges, masses, step_s)
    # One sweep goes a part of the way to where a hinge is content, and gravity as far back in the
    # next step: at rest it would be as compliant as its masses add. Stiffer hinges keep a rest.
    left = np.maximum(compliance - masses, _LEAST_COMPLIANCE * masses)
    ease = 1 / ((1 + damping) * masses + left)
    return np.stack([hinges.lengths_m, masses, damping, ease], axis=1)


def _responses(
    constraints: Springs | Hinges,
    masses: np.ndarray,
    step_s: float,
    most_damping: float = np.inf,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compliance, damping and ease of constraints by the inverse masses (C,) that they act on.

    Macklin et al. 2016, "XPBD", equations 18 and 26.
    """
    compliance = 1 / constraints.stiffness_n_m
    damping = np.minimum(compliance * constraints.damping_kg_s / step_s, most_damping)
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
    push = numbers[spring, 0] - length
    kind = 1
    if push > 0.0 and (begins == 1 or pull[spring] >= 0.0):
        kind = 3
    push -= numbers[spring, 5] * (length - lengths[spring])
    if begins == 0:
        push -= numbers[spring, kind] * pull[spring]
    push *= share * numbers[spring, kind + 1]
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
