"""Metrics of reconstructed garment sequences (Garment4D 3.1), one sequence at a time.

Every error is a mean over all vertices of all frames of a whole sequence, never over batches or
windows that repeat frames. Vertices are those of a garment template, in metres, in any frame of
reference that prediction and truth share.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh, vertex_normals
from drapeline.metrics.garment import (
    CONTACT_STEP,
    area_distance_mm,
    inside_measures,
    surface_distances_mm,
)


class BodyFrames(NamedTuple):
    """The body under a garment: (V, 3) metres by frame, as the garment is placed, and faces."""

    vertices: Callable[[int], np.ndarray]
    faces: np.ndarray


def vertex_errors_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(...) Euclidean distances of corresponding vertices (..., 3)."""
    away = np.asarray(predicted, dtype=np.float64) - true
    return 1000 * np.linalg.norm(away, axis=-1)


def vertex_error_mm(predicted: np.ndarray, true: np.ndarray) -> float:
    """M1, M2: mean distance of corresponding canonical (N, 3) or posed (F, N, 3) vertices."""
    return float(vertex_errors_mm(predicted, true).mean())


def acceleration_error_m_s2(predicted: np.ndarray, true: np.ndarray) -> float:
    """M3: mean length of the difference of accelerations, by second differences.

    Args:
        predicted, true: (F, N, 3) metres, consecutive frames of one whole sequence, 30 per second.

    Returns:
        m/s^2, over the F - 2 frames that have both neighbours; NaN with fewer than three frames.
    """
    return _derivative_error(predicted, true, 2)


def velocity_error_m_s(predicted: np.ndarray, true: np.ndarray) -> float:
    """Mean length of the difference of velocities, by first differences.

    Unlike M3, it grows when cloth swings late or not at all, and hardly with noise.

    Args:
        predicted, true: (F, N, 3) metres, consecutive frames of one whole sequence, 30 per second.

    Returns:
        m/s, over the F - 1 steps; NaN with a single frame.
    """
    return _derivative_error(predicted, true, 1)


def _derivative_error(predicted: np.ndarray, true: np.ndarray, order: int) -> float:
    if len(true) <= order:
        return float("nan")
    # Differences are linear: those of the error are the difference of the two.
    error = np.asarray(predicted, dtype=np.float64) - true
    return float(FPS**order * np.linalg.norm(np.diff(error, n=order, axis=0), axis=-1).mean())


# Of motion, from and to Hz: swinging with the body, folds, and what shakes.
_BANDS_HZ = {"slow_motion": (0, 2), "quick_motion": (2, 5), "fast_motion": (5, FPS)}


def motion_spectrum(predicted: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """How much a garment moves at several speeds, as shares of what the true one does.

    1 is as much; less in the upper bands is cloth that is too stiff or smoothed, more is noise.

    Args:
        predicted, true: (F, N, 3) metres, consecutive frames of one whole sequence, 30 per second,
            relative to the root joint.

    Returns:
        Per band the ratio of root mean squares of velocities; NaN where the true ones are none, or
        with fewer than three frames.
    """
    if len(true) < 3:
        return dict.fromkeys(_BANDS_HZ, float("nan"))
    powers = []
    for motion in (predicted, true):
        velocity = FPS * np.diff(np.asarray(motion, dtype=np.float64), axis=0)
        window = np.hanning(len(velocity) + 2)[1:-1, None, None]
        powers.append((np.abs(np.fft.rfft(window * velocity, axis=0)) ** 2).sum(axis=(1, 2)))
    frequency = np.fft.rfftfreq(len(true) - 1, 1 / FPS)
    shares = {}
    for name, (low, high) in _BANDS_HZ.items():
        band = (frequency >= low) & (frequency < high)
        ours, theirs = (float(power[band].sum()) for power in powers)
        shares[name] = float(np.sqrt(ours / theirs)) if theirs > 0 else float("nan")
    return shares


def split_error_mm(predicted: np.ndarray, true: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    """M2 in two: off the true surface, along its normals, and beside the right place on it.

    Args:
        predicted, true: (F, N, 3) metres.
        faces: (E, 3).
    """
    error = np.asarray(predicted, dtype=np.float64) - true
    normals = np.stack([vertex_normals(frame, faces) for frame in true])
    off = (error * normals).sum(axis=-1)
    along = np.sqrt(np.maximum((error**2).sum(axis=-1) - off**2, 0))
    return {
        "off_surface_mm": float(1000 * np.abs(off).mean()),
        "along_surface_mm": float(1000 * along.mean()),
    }


def to_cloud_mm(vertices: Iterable[np.ndarray], points: Iterable[np.ndarray]) -> float:
    """One-way Chamfer distance (table 5): mean distance of vertices to the nearest of the points.

    Both are given frame by frame: (N, 3), and (P, 3) with any P. Parts that the garment lacks do
    not change it.
    """
    distances = [
        KDTree(cloud).query(garment)[0].mean()
        for garment, cloud in zip(vertices, points, strict=True)
    ]
    return float(1000 * np.mean(distances))


def segmentation_accuracy(predicted: np.ndarray, true: np.ndarray) -> float:
    """Share of the points of a sequence with the right label; labels (F, P)."""
    return float((np.asarray(predicted) == true).mean())


def inside_means(garment: np.ndarray, body: BodyFrames) -> dict[str, float]:
    """`inside_measures` of every fifth frame of a garment (F, N, 3), averaged over them."""
    measures = [
        inside_measures(np.asarray(garment[frame]), body.vertices(frame), body.faces)
        for frame in range(0, len(garment), CONTACT_STEP)
    ]
    return {name: float(np.mean([one[name] for one in measures])) for name in measures[0]}


def surface_means(predicted: Iterable[Mesh], true: Iterable[Mesh]) -> dict[str, float]:
    """Distances between surfaces of triangles, averaged over pairs of them.

    Vertex errors also count sliding along the surface, which nobody sees.
    """
    both = [surface_distances_mm(*pair) for pair in zip(predicted, true, strict=True)]
    to_true, to_predicted = np.mean(both, axis=0).tolist()
    return {"predicted_to_true_mm": to_true, "true_to_predicted_mm": to_predicted}


def sequence_measures(
    garment: np.ndarray,
    true: np.ndarray | None = None,
    *,
    body: BodyFrames | None = None,
    points: Iterable[np.ndarray] | None = None,
    faces: np.ndarray | None = None,
) -> dict[str, float]:
    """All measures of a posed garment that the arguments allow.

    Args:
        garment: (F, N, 3) posed vertices, metres; the truth itself to measure it.
        true: (F, N, 3), or None for scans, which have no ground truth.
        body: that wears the garment, to measure what is inside it.
        points: (P, 3) per frame, for the one-way distance.
        faces: (E, 3) of the garment, for distances between its surface and the true one.
    """
    measures = {}
    if true is not None:
        measures["vertex_error_mm"] = vertex_error_mm(garment, true)
        measures["velocity_error_m_s"] = velocity_error_m_s(garment, true)
        measures["acceleration_error_m_s2"] = acceleration_error_m_s2(garment, true)
        measures |= motion_spectrum(garment, true)
        if faces is not None:
            both = garment[::CONTACT_STEP], true[::CONTACT_STEP]
            measures |= split_error_mm(garment, true, faces)
            measures |= surface_means(*([Mesh(v, faces) for v in some] for some in both))
    if points is not None:
        measures["to_cloud_mm"] = to_cloud_mm(garment, points)
    if body is not None:
        measures |= inside_means(garment, body)
    return measures


def canonical_measures(
    predicted: Mesh, true: np.ndarray | None = None, original: Mesh | None = None
) -> dict[str, float]:
    """All measures of a canonical garment that the arguments allow.

    Args:
        predicted: in template topology, N vertices; the truth itself to measure registration.
        true: (N, 3), the registered garment.
        original: the garment before registration, triangles. Registration loses parts of it, and
            M1 alone would not show errors there.
    """
    measures = {}
    if true is not None:
        measures["canonical_error_mm"] = vertex_error_mm(predicted.vertices, true)
    if original is not None:
        measures["canonical_to_original_mm"] = area_distance_mm(predicted, original)
    return measures
