"""Fitting garments to a body: resizing, leaving it, lying over another, and hanging with folds."""

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial import KDTree

from drapeline.geometry.mesh import boundary_loops, edge_lengths
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.geometry.smoothing import Constraint, averaging_matrix, blur, spread_pushes
from drapeline.outfits.dress_form import DressForm
from drapeline.outfits.patterns.curves import smoothstep
from drapeline.outfits.patterns.panels import Pattern, separator

RESIZE_PASSES = 40  # Laplacian passes over the displacements at edges of ...
RESIZE_EDGE_M = 0.01  # ... this length; finer meshes take more for the same reach
_ANGLE_BINS = 72
_HEIGHT_BIN_M = 0.01
_NEAREST = 8
_ROUNDS, _SPREAD_ROUNDS, _SPREAD_PASSES = 8, 5, 6
_OVERSHOOT = 1.02  # of a push, so that it arrives within the rounds
_OVER_PASSES = 10
_HELD_REACH_M = 0.06  # from held cloth to where it hangs as it is cut


def resize(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    mean_body: np.ndarray,
    target_body: np.ndarray,
    passes: int,
) -> np.ndarray:
    """(V, 3) metres of a garment moved as the body under it moves from one shape to another.

    Every vertex takes the mean displacement of the nearest body vertices; smoothing the
    displacements keeps the body's details off the cloth.

    Args:
        vertices: (V, 3) garment on `mean_body`, metres.
        average: (V, V) of `averaging_matrix`.
        mean_body, target_body: (B, 3) body before and after.
        passes: of smoothing.
    """
    _, nearest = KDTree(mean_body).query(vertices, k=_NEAREST)
    displacement = (target_body - mean_body)[nearest].mean(axis=1)
    return vertices + blur(displacement, average, passes)


def leave_body(
    vertices: np.ndarray,
    average: sp.csr_matrix,
    body: SignedDistance,
    gap_m: float,
    separate: Constraint | None = None,
) -> np.ndarray:
    """(V, 3) metres of a garment pushed out until every vertex is at least `gap_m` off the body.

    Pushes are spread over the neighbourhood so that the body does not emboss the cloth.

    Args:
        vertices: (V, 3) metres.
        average: (V, V) of `averaging_matrix`.
        body: signed distances to it.
        gap_m: between body and cloth.
        separate: applied last in every round, see `separator`; it wins over the gap where a body
            leaves no room, as between thighs that touch.
    """
    points = vertices.copy()
    for round_ in range(_ROUNDS):
        distance, out = body.query(points)
        lack = np.maximum(gap_m - distance, 0)
        if lack.max() <= 1e-6:
            break
        push = lack[:, None] * out * _OVERSHOOT
        if round_ < _SPREAD_ROUNDS:
            push = spread_pushes(push, average, _SPREAD_PASSES)
        points += push
        if separate is not None:
            points = separate(points)
    return points


def lay_on(
    vertices: np.ndarray,
    body: SignedDistance,
    held: np.ndarray,
    gap_m: float,
    collar: np.ndarray | None = None,
) -> np.ndarray:
    """(V, 3) metres of a garment whose held vertices lie on the body, others less with distance.

    Args:
        vertices: (V, 3) metres, outside the body.
        body: signed distances to it.
        held: (V,) bool, such as those of a waistband and of the shoulders.
        gap_m: between body and cloth that is held.
        collar: (R, C) vertices of a collar, which moves with its first row.
    """
    if not held.any():
        return vertices
    away, _ = KDTree(vertices[held]).query(vertices)
    share = 1 - smoothstep(away / _HELD_REACH_M)
    distance, out = body.query(vertices)
    move = -(share * np.maximum(distance - gap_m, 0))[:, None] * out
    if collar is not None:
        move[collar[1:]] = move[collar[0]]
    return vertices + move


def lay_over(
    outer: np.ndarray, average: sp.csr_matrix, inner: np.ndarray, axis_y: float, gap_m: float
) -> np.ndarray:
    """(V, 3) metres of the outer garment, moved off the body's axis until it clears the inner one.

    Args:
        outer, inner: (V, 3) and (W, 3) vertices, metres; of the inner garment only the outline
            by height and angle counts.
        average: (V, V) of `averaging_matrix`, of the outer garment.
        axis_y: where the vertical axis stands.
        gap_m: between the garments.
    """
    base = min(inner[:, 2].min(), outer[:, 2].min())
    rows = int((inner[:, 2].max() - base) / _HEIGHT_BIN_M) + 2

    def cylindrical(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and angle in bins, and radius in metres."""
        angle = np.arctan2(points[:, 0], points[:, 1] - axis_y) % (2 * np.pi)
        radius = np.hypot(points[:, 0], points[:, 1] - axis_y)
        return (points[:, 2] - base) / _HEIGHT_BIN_M, angle / (2 * np.pi) * _ANGLE_BINS, radius

    height, angle, radius = cylindrical(inner)
    outline = np.zeros((rows, _ANGLE_BINS))
    np.maximum.at(
        outline, (np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS), radius
    )
    outline = maximum_filter(outline, size=(5, 3), mode=("nearest", "wrap"))
    outline = gaussian_filter(outline, 1.0, mode=("nearest", "wrap"))
    height, angle, radius = cylindrical(outer)
    row, column = np.round(height).astype(int), np.round(angle).astype(int) % _ANGLE_BINS
    beside = row < rows
    need = np.zeros(len(outer))
    need[beside] = outline[row[beside], column[beside]]
    push = np.where(need > 0, np.maximum(need + gap_m - radius, 0), 0)
    for _ in range(_OVER_PASSES):
        push = np.maximum(push, average @ push)
    spoke = (outer[:, :2] - [0, axis_y]) / np.maximum(radius, 1e-9)[:, None]
    moved = outer.copy()
    moved[:, :2] += push[:, None] * spoke
    return moved


# Light cloth that loses its speed at once: fullness makes the folds, weight only directs them.
_FALL_M = 7e-5
_KEEP_SPEED = 0.6
_PROJECTIONS = 2
_SHEAR_STIFFNESS = 0.35
# How much of the fullness each family of springs gets.
_WEFT_FULLNESS, _WARP_FULLNESS, _SHEAR_FULLNESS = 1.0, 0.15, 0.6
_RELAXATION = 0.6
_STEPS = 30
_GAP_M = 0.006  # of the cloth from the dress form
_CALM_M = 0.04  # the ends of a garment stay free of folds over this distance
# Seeds of folds: their size, and how far they reach along the warp and along the weft.
_FOLD_M = 0.0015
_FOLD_LENGTH_M = 0.08
_FOLD_WIDTH_M = 0.018


def drape_on_form(
    rng: np.random.Generator,
    form: DressForm,
    pattern: Pattern,
    edge_length_m: float,
    fullness: float,
) -> np.ndarray:
    """(V, 3) metres of a garment that hung on the dress form for a moment.

    Args:
        rng: decides where folds begin.
        form: the dress form that the pattern was cut on.
        fullness: excess of cloth around the body, as a share.
    """
    points, faces = pattern.vertices, pattern.faces()
    nudge = seed_folds(rng, faces, len(points), edge_length_m, _FOLD_M * (0.2 + 60 * fullness))
    ends = np.concatenate(boundary_loops(faces))
    calm = smoothstep(KDTree(points[ends]).query(points)[0] / _CALM_M)
    if "skirt_hem" in pattern.marks:
        calm = np.maximum(calm, smoothstep((form.landmarks["hip"] - points[:, 2]) / _CALM_M))
    held = np.zeros(len(points), dtype=bool)
    if "hem" not in pattern.marks and "left_armhole" not in pattern.marks:
        held[pattern.marks["waist"]] = True
    if "collar" in pattern.marks:
        held[pattern.marks["collar"]] = True
    high = points[:, 2] > form.landmarks["waist"]
    separate = separator(pattern)

    def keep_out(p: np.ndarray) -> np.ndarray:
        for part, field in ((high, form.upper), (~high, form.lower)):
            if part.any():
                p[part] = field.lift(p[part], _GAP_M)
        return separate(p)

    return drape(
        points,
        faces,
        held,
        keep_out,
        fullness=fullness * calm,
        nudge=nudge * calm[:, None],
        steps=_STEPS,
    )


def drape(
    start: np.ndarray,
    faces: np.ndarray,
    held: np.ndarray,
    keep_out: Constraint,
    *,
    fullness: np.ndarray,
    nudge: np.ndarray,
    steps: int,
) -> np.ndarray:
    """(V, 3) metres of a garment after position-based dynamics (Mueller et al. 2007).

    Args:
        start: (V, 3) metres.
        faces: (F, 4), the first edge of each along the weft (around), the second along the warp.
        held: (V,) bool, vertices that stay.
        keep_out: moves points out of the dress form, after each step.
        fullness: (V,) excess of cloth around the body, as a share; it makes the folds.
        nudge: (V, 3) metres, added to the start where vertices are not held: folds begin there.
    """
    weft = np.concatenate([faces[:, [0, 1]], faces[:, [2, 3]]])
    warp = np.concatenate([faces[:, [1, 2]], faces[:, [3, 0]]])
    shear = np.concatenate([faces[:, [0, 2]], faces[:, [1, 3]]])
    pairs = np.concatenate([weft, warp, shear])
    stiffness = np.ones(len(pairs))
    stiffness[-len(shear) :] = _SHEAR_STIFFNESS
    rest = edge_lengths(start, pairs)
    share = np.repeat(
        [_WEFT_FULLNESS, _WARP_FULLNESS, _SHEAR_FULLNESS], [len(weft), len(warp), len(shear)]
    )
    rest *= 1 + share * fullness[pairs].mean(axis=1)
    count = len(start)
    rows, signs = np.repeat(np.arange(len(pairs)), 2), np.tile([1.0, -1.0], len(pairs))
    difference = sp.csr_matrix((signs, (rows, pairs.ravel())), shape=(len(pairs), count))
    weight = np.bincount(pairs.ravel(), np.repeat(stiffness, 2), count)
    # Jacobi projection: every vertex takes the weighted mean of what its springs ask for.
    gather = (sp.diags(_RELAXATION / weight) @ difference.T @ sp.diags(stiffness)).tocsr()
    x, before = np.where(held[:, None], start, start + nudge), start
    for _ in range(steps):
        ahead = x + _KEEP_SPEED * (x - before) - [0.0, 0.0, _FALL_M]
        ahead[held] = start[held]
        before = x
        for _ in range(_PROJECTIONS):
            span = difference @ ahead
            length = np.sqrt(np.einsum("si,si->s", span, span))
            ahead += gather @ (span * (rest / np.maximum(length, 1e-9) - 1)[:, None])
            ahead[held] = start[held]
        x = keep_out(ahead)
    return x


def seed_folds(
    rng: np.random.Generator, faces: np.ndarray, count: int, edge_length_m: float, size_m: float
) -> np.ndarray:
    """Draw (count, 3) metres where folds begin, long along the warp and short along the weft.

    Args:
        rng: draws the noise that is smoothed.
        faces: (F, 4), the first edge of each along the weft, the second along the warp.
        count: number of vertices.
        size_m: root mean square of the displacements' coordinates.
    """
    noise = rng.normal(size=(count, 3))
    along = averaging_matrix(faces[:, [1, 2, 2, 1]], count)
    around = averaging_matrix(faces[:, [0, 1, 1, 0]], count)
    # Averaging passes reach as far as the square root of their number.
    for average, reach_m in ((along, _FOLD_LENGTH_M), (around, _FOLD_WIDTH_M)):
        for _ in range(max(1, round((reach_m / edge_length_m) ** 2 / 2))):
            noise = average @ noise
    return noise * (size_m / np.sqrt((noise**2).mean()))
