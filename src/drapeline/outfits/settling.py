"""A short settling under a little weight, so that garments hang instead of standing like moulds."""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from drapeline.geometry.mesh import boundary_loops, edge_lengths
from drapeline.geometry.smoothing import Constraint, averaging_matrix
from drapeline.outfits.dress_form import DressForm
from drapeline.outfits.patterns.curves import smoothstep
from drapeline.outfits.patterns.panels import Pattern
from drapeline.outfits.patterns.separation import separator

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
    """Hang a garment on the dress form for a moment.

    Args:
        rng: decides where folds begin.
        form: the dress form that the pattern was cut on.
        pattern: the garment.
        edge_length_m: its mean edge length.
        fullness: excess of cloth around the body, as a share.

    Returns:
        (V, 3) metres, the pattern's vertices after settling.
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
    high = points[:, 2] > form.landmarks["waist"]
    separate = separator(pattern)

    def keep_out(p: np.ndarray) -> np.ndarray:
        for part, field in ((high, form.upper), (~high, form.lower)):
            if part.any():
                p[part] = field.lift(p[part], _GAP_M)
        return separate(p)

    return settle(
        points,
        faces,
        held,
        keep_out,
        fullness=fullness * calm,
        nudge=nudge * calm[:, None],
        steps=_STEPS,
    )


def settle(
    start: np.ndarray,
    faces: np.ndarray,
    held: np.ndarray,
    keep_out: Constraint,
    *,
    fullness: np.ndarray,
    nudge: np.ndarray,
    steps: int,
) -> np.ndarray:
    """Let a garment settle with position-based dynamics (Mueller et al. 2007).

    Args:
        start: (V, 3) metres.
        faces: (F, 4), the first edge of each along the weft (around), the second along the warp.
        held: (V,) bool, vertices that stay.
        keep_out: moves points out of the dress form, after each step.
        fullness: (V,) excess of cloth around the body, as a share; it makes the folds.
        nudge: (V, 3) metres, added to the start where vertices are not held: folds begin there.
        steps: number of steps.

    Returns:
        (V, 3) metres.
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
    """Draw displacements where folds begin, long along the warp and short along the weft.

    Args:
        rng: draws the noise that is smoothed.
        faces: (F, 4), the first edge of each along the weft, the second along the warp.
        count: number of vertices.
        edge_length_m: mean edge length.
        size_m: root mean square of the displacements' coordinates.

    Returns:
        (count, 3) metres.
    """
    noise = rng.normal(size=(count, 3))
    along = averaging_matrix(faces[:, [1, 2, 2, 1]], count)
    around = averaging_matrix(faces[:, [0, 1, 1, 0]], count)
    # Averaging passes reach as far as the square root of their number.
    for average, reach_m in ((along, _FOLD_LENGTH_M), (around, _FOLD_WIDTH_M)):
        for _ in range(max(1, round((reach_m / edge_length_m) ** 2 / 2))):
            noise = average @ noise
    return noise * (size_m / np.sqrt((noise**2).mean()))
