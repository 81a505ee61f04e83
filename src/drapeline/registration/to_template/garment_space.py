"""The shape space of a garment type: T(alpha) = G + C alpha (Garment4D, section 2.1)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from drapeline.errors import InputError
from drapeline.storage import load_record, save_record

# A coordinate that hardly varies would blow up its noise to the size of a sleeve's length.
_SCALE_FLOOR_M = 0.002
_RANK = 1e-6  # deviation of a direction, in the first one's, that is rounding alone


@dataclass(frozen=True)
class GarmentSpace:
    """Principal components of canonical garments in one topology."""

    faces: Annotated[np.ndarray, "int<n * 3"]
    mean: Annotated[np.ndarray, "float n 3"]  # G, metres
    # C, metres per unit of a coefficient; over the training garments every coefficient has mean 0
    # and variance 1.
    components: Annotated[np.ndarray, "float d n 3"]
    explained: Annotated[np.ndarray, "float d"]  # share of the standardised variance, falling
    scale: Annotated[np.ndarray, "float n 3"]  # metres, deviation that coordinates were divided by

    def coefficients(self, vertices: np.ndarray) -> np.ndarray:
        """Alpha (..., D) float32 of garments (..., N, 3): least squares in standardised metres."""
        basis = (self.components / self.scale).reshape(len(self.components), -1)
        basis = basis.astype(np.float64)
        gap = (np.asarray(vertices, dtype=np.float64) - self.mean) / self.scale
        gap = gap.reshape(*gap.shape[:-2], -1)
        # Components are orthogonal after the division, each as long as its coefficient deviates.
        return (gap @ basis.T / (basis**2).sum(axis=1)).astype(np.float32)

    def vertices(self, alpha: np.ndarray) -> np.ndarray:
        """T(alpha) (..., N, 3) float32 metres of coefficients (..., D)."""
        flat = np.asarray(alpha) @ self.components.reshape(len(self.components), -1)
        moved = flat.reshape(*flat.shape[:-1], -1, 3)
        return (self.mean + moved).astype(np.float32)

    def metric(self) -> np.ndarray:
        """(D, D) M, so that e @ M @ e is the mean squared error in m^2 of alpha that is e off."""
        rows = self.components.reshape(len(self.components), -1)
        return rows @ rows.T / len(self.mean)

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_record(path, self)


def load_space(path: str | Path) -> GarmentSpace:
    """Read what `GarmentSpace.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return load_record(path, GarmentSpace)


def fit_space(canonical: np.ndarray, components: int, faces: np.ndarray) -> GarmentSpace:
    """Fit the space to training garments; as released, coordinates are standardised first.

    Args:
        canonical: (S, N, 3) metres, garments of the training split in one topology.
        components: D wanted; at most S - 1 are kept.
        faces: (F, 3) of that topology.

    Raises:
        InputError: fewer than two garments, or one that is not finite.
    """
    count = len(canonical)
    if count < 2:
        raise InputError(f"{count} training garments make no shape space, expected two or more")
    flat = np.asarray(canonical, dtype=np.float64).reshape(count, -1)
    bad = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if len(bad):
        raise InputError(f"training garment {bad[0]} is not finite, expected metres")
    mean = flat.mean(axis=0)
    scale = np.maximum(flat.std(axis=0), _SCALE_FLOOR_M)
    gap = (flat - mean) / scale
    _, singular, right = np.linalg.svd(gap, full_matrices=False)
    # Directions without variance, such as the last one of centred rows, have no coefficient.
    kept = min(components, int((singular > _RANK * singular[0]).sum()))
    # The sign of a component is free: its largest entry is positive.
    largest = right[np.arange(len(right)), np.abs(right).argmax(axis=1)]
    right = right * np.sign(largest)[:, None]
    deviation = singular / np.sqrt(count)
    basis = deviation[:kept, None] * right[:kept] * scale
    shape = canonical.shape[1:]
    return GarmentSpace(
        np.asarray(faces, dtype=np.int32),
        mean.reshape(shape).astype(np.float32),
        basis.reshape(kept, *shape).astype(np.float32),
        (singular**2 / max((singular**2).sum(), 1e-30))[:kept],
        scale.reshape(shape).astype(np.float32),
    )
