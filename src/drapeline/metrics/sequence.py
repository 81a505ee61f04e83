"""How good reconstructed garment sequences are (Garment4D 3.1), one sequence at a time.

Every error is a mean over all vertices of all frames of a whole sequence: never over batches,
nor over windows that repeat frames. Vertices are those of a garment template, in metres, in any
frame that prediction and truth share.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import area_distance_mm, inside_measures
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.seeding import rng_for

MODEL = "garment4d"
FPS = 30.0
CONTACT_EVERY = 5


class MovingBody(NamedTuple):
    """The body under a garment.

    Attributes:
        vertices: frame -> (V, 3) body vertices in the garment's frame of reference, metres.
        faces: (F, 3) of the body.
    """

    vertices: Callable[[int], np.ndarray]
    faces: np.ndarray


class Measured(NamedTuple):
    """What was measured of one sequence.

    Attributes:
        sequence: its name; sequences of one name are resampled together.
        garment: its type.
        measures: metric -> value; NaN where a metric has no meaning.
    """

    sequence: str
    garment: str
    measures: Mapping[str, float]


def vertex_errors_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(...) Euclidean distances of corresponding vertices (..., 3)."""
    away = np.asarray(predicted, dtype=np.float64) - true
    return 1000 * np.linalg.norm(away, axis=-1)


def vertex_error_mm(predicted: np.ndarray, true: np.ndarray) -> float:
    """M1, M2: mean distance of corresponding canonical (N, 3) or posed (F, N, 3) vertices."""
    return float(vertex_errors_mm(predicted, true).mean())


def acceleration_error_m_s2(predicted: np.ndarray, true: np.ndarray, *, fps: float = FPS) -> float:
    """M3: mean length of the difference of accelerations, by second differences.

    Args:
        predicted, true: (F, N, 3) metres, consecutive frames of one whole sequence.
        fps: frames per second.

    Returns:
        m/s^2, over the F - 2 frames that have both neighbours; NaN with fewer than three frames.
    """
    if len(true) < 3:
        return float("nan")
    # Second differences are linear: those of the error are the difference of the two.
    error = np.asarray(predicted, dtype=np.float64) - true
    return float(fps**2 * np.linalg.norm(np.diff(error, n=2, axis=0), axis=-1).mean())


def to_cloud_mm(vertices: Sequence[np.ndarray], points: Sequence[np.ndarray]) -> float:
    """One-way Chamfer distance (table 5): mean distance of vertices to the nearest point.

    It does not see what a garment lacks, nor what a cloud lacks.

    Args:
        vertices: (N, 3) per frame.
        points: (P, 3) of the whole cloud per frame; P may differ between frames.
    """
    found = [
        KDTree(cloud).query(garment)[0].mean()
        for garment, cloud in zip(vertices, points, strict=True)
    ]
    return float(1000 * np.mean(found))


def segmentation_accuracy(predicted: np.ndarray, true: np.ndarray) -> float:
    """Share of the points of a sequence with the right label; labels (F, P)."""
    return float((np.asarray(predicted) == true).mean())


def inside_means(
    garment: np.ndarray, body: MovingBody, *, every: int = CONTACT_EVERY
) -> dict[str, float]:
    """`inside_measures` of every so many frames of a garment (F, N, 3), averaged over them."""
    found = [
        inside_measures(np.asarray(garment[frame]), body.vertices(frame), body.faces)
        for frame in range(0, len(garment), every)
    ]
    return {name: float(np.mean([one[name] for one in found])) for name in found[0]}


def sequence_measures(
    garment: np.ndarray,
    true: np.ndarray | None = None,
    *,
    body: MovingBody | None = None,
    points: Sequence[np.ndarray] | None = None,
    consecutive: bool = True,
) -> dict[str, float]:
    """Everything that can be said of a sequence with what is given.

    Args:
        garment: (F, N, 3) posed vertices, metres; the truth itself to measure it.
        true: (F, N, 3), or None for scans, which have no ground truth.
        body: that the garment is on, for what is inside of it.
        points: (P, 3) per frame, for the one-way distance.
        consecutive: whether these are all frames of a motion at `FPS`; accelerations over longer
            steps are other numbers, so M3 is left out.
    """
    found = {}
    if true is not None:
        found["vertex_error_mm"] = vertex_error_mm(garment, true)
        if consecutive:
            found["acceleration_error_m_s2"] = acceleration_error_m_s2(garment, true)
    if points is not None:
        found["to_cloud_mm"] = to_cloud_mm(garment, points)
    if body is not None:
        found |= inside_means(garment, body)
    return found


def canonical_measures(
    predicted: Mesh, true: np.ndarray | None = None, original: Mesh | None = None
) -> dict[str, float]:
    """Everything about the canonical garment of one sequence.

    Args:
        predicted: in template topology, N vertices; the truth itself to measure registration.
        true: (N, 3), the registered garment.
        original: the garment as simulated, triangles: registration leaves some of it out, so
            that M1 alone would not see its errors.
    """
    found = {}
    if true is not None:
        found["canonical_error_mm"] = vertex_error_mm(predicted.vertices, true)
    if original is not None:
        found["canonical_to_original_mm"] = area_distance_mm(predicted, original)
    return found


def sequence_summary(
    measured: Sequence[Measured], *, variant: str, split: str, seed: int
) -> list[MetricRow]:
    """Rows of the table of metrics: means over sequences, with intervals from resampling them.

    Each sequence counts alike, however long it is.

    Args:
        measured: of one variant on one split.
        variant: name in the table.
        split: of the sequences.
        seed: of the training; draws the intervals too.
    """
    return summary_rows(
        rng_for(seed, "intervals", MODEL, variant, split),
        [one.measures for one in measured],
        [one.garment for one in measured],
        [one.sequence for one in measured],
        model=MODEL,
        variant=variant,
        split=split,
        seed=seed,
    )
