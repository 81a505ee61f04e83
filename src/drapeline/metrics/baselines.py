"""Predictions of garments at rest that need no network, and their metrics.

The mean garment and the nearest neighbour know only a garment's type and conditioning variables;
PCA, like an autoencoder, is given the garment itself and reconstructs it from a small code.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drapeline.learning_data.training_rows import (
    MirroredGarments,
    linear_rows,
    with_mirror_images,
)
from drapeline.metrics.registered import (
    StaticRows,
    Truth,
    measure_predictions,
    measure_truth,
    measured_at_rest,
)
from drapeline.metrics.table import join, summarise
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rule_log import progress
from drapeline.schema import Table

_BLOCK = 8192  # columns


@dataclass(frozen=True)
class MeanGarment:
    """Mean offsets and mask of every garment type of the training set."""

    # (types, V, 3) metres, each vertex averaged over the garments that cover it.
    offsets: np.ndarray
    mask: np.ndarray  # (types, V), covered by more than half of the garments


def fit_mean_garment(
    offsets: np.ndarray, mask: np.ndarray, garment: np.ndarray, train: np.ndarray, types: int
) -> MeanGarment:
    """Average per type.

    Args:
        offsets: (N, V, 3) metres, zero outside the mask; may be memory-mapped.
        mask: (N, V) bool.
        garment: (N,) type.
        train: (n,) rows to learn from.
        types: number of types; a type that no row has stays empty.
    """
    count = offsets.shape[1]
    total = np.zeros((types, count, 3))
    covered = np.zeros((types, count))
    for row in train:
        total[garment[row]] += offsets[row]
        covered[garment[row]] += mask[row]
    size = np.bincount(garment[train], minlength=types)[:, None]
    mean = total / np.maximum(covered, 1)[..., None]
    return MeanGarment(mean.astype(np.float32), covered > size / 2)


def nearest_rows(
    cvar: np.ndarray, garment: np.ndarray, train: np.ndarray, rows: Sequence[int]
) -> np.ndarray:
    """Training row of the same type whose conditioning variables are nearest.

    Args:
        cvar: (N, C); each variable is scaled by its deviation over the training rows.
        garment: (N,) type.
        train: (n,) rows to choose from.
        rows: to find neighbours for.

    Returns:
        (len(rows),) training rows; of any type where the training set lacks the row's.
    """
    deviation = cvar[train].std(axis=0)
    scaled = cvar / np.where(deviation > 0, deviation, 1)
    nearest = []
    for row in rows:
        same = train[garment[train] == garment[row]]
        pool = same if len(same) else train
        nearest.append(pool[np.linalg.norm(scaled[pool] - scaled[row], axis=1).argmin()])
    return np.array(nearest, dtype=np.int64)


@dataclass(frozen=True)
class GarmentPca:
    """Principal components of offsets, and the mask that goes with them by linear regression."""

    mean: np.ndarray  # (3V,) metres
    axes: np.ndarray  # (C, 3V) orthonormal, by falling variance
    mask_mean: np.ndarray  # (V,)
    mask_axes: np.ndarray  # (C, V), mask per unit of coefficient

    def first(self, count: int) -> "GarmentPca":
        """The same with its first components alone."""
        return replace(self, axes=self.axes[:count], mask_axes=self.mask_axes[:count])

    def reconstruct(self, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (V, 3) through the code and back: offsets (V, 3) and mask (V,)."""
        code = self.axes @ (offsets.ravel() - self.mean)
        mask = self.mask_mean + code @ self.mask_axes > 0.5
        return (self.mean + code @ self.axes).reshape(-1, 3), mask


def fit_training_pca(
    garments: MirroredGarments, mirror: np.ndarray | None, *, components: int, seed: int
) -> GarmentPca:
    """Principal components of the rows, and mirror images, that masked PPCA is fitted to.

    Args:
        mirror: (V,) vertices of the body that lie opposite; None if it is not symmetric.
        components: at most.
        seed: draws the rows, see `linear_rows`.
    """
    rows = linear_rows(garments, "train", seed)
    batches = with_mirror_images(garments, rows, mirror)
    offsets, mask = (np.concatenate([each[key] for each in batches]) for key in ("offsets", "mask"))
    return fit_pca(offsets, mask, components)


def fit_pca(offsets: np.ndarray, mask: np.ndarray, components: int) -> GarmentPca:
    """Principal components of offsets.

    Args:
        offsets: (n, V, 3) metres, zero outside the mask.
        mask: (n, V) bool.
        components: at most n - 1 are used.
    """
    data = offsets.reshape(len(offsets), -1)
    mean = data.mean(axis=0)
    data = data - mean
    values, vectors = np.linalg.eigh(_row_products(data))
    count = min(components, len(data) - 1)
    values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
    kept = values > 1e-10 * max(values[0], 1e-30) if count else np.zeros(0, dtype=bool)
    values, vectors = values[kept], vectors[:, kept]
    axes = _combine((vectors / np.sqrt(values)).T, data)
    covered = mask.astype(np.float32)
    mask_mean = covered.mean(axis=0)
    # Coefficients are uncorrelated, so that each one's regression is independent of the others.
    code = (vectors * np.sqrt(values)).astype(np.float32)
    mask_axes = code.T @ (covered - mask_mean) / values[:, None].astype(np.float32)
    return GarmentPca(mean, axes, mask_mean, mask_axes)


def _row_products(data: np.ndarray) -> np.ndarray:
    """(n, n) products of the rows of `data` (n, D), whose eigenvalues are those of the components.

    n is far below D. Summed in 64 bits, block by block: rounding a large component to 32 bits loses
    more than a small component holds.
    """
    total = np.zeros((len(data), len(data)))
    for block in _blocks(data):
        total += block @ block.T
    return total


def _combine(weights: np.ndarray, data: np.ndarray) -> np.ndarray:
    """(C, D) float32 weighted sums of the rows of `data` (n, D), in 64 bits for the same reason."""
    parts = [(weights @ block).astype(np.float32) for block in _blocks(data)]
    return np.concatenate(parts, axis=1)


def _blocks(data: np.ndarray) -> Iterator[np.ndarray]:
    for start in range(0, data.shape[1], _BLOCK):
        yield data[:, start : start + _BLOCK].astype(np.float64)


Predictor = Callable[[int], tuple[np.ndarray, np.ndarray]]


def garment_baselines(garments: StaticRows) -> dict[str, Predictor]:
    """Name -> function from a row to its guessed offsets (V, 3) in metres and mask (V,).

    They are fitted to the training split, and know the type and conditioning variables of a row.
    """
    offsets, mask, garment = garments.offsets, garments.mask, garments.garment
    train, cvar = garments.rows("train"), garments.cvar(np.arange(len(garments.garment)))
    mean = fit_mean_garment(offsets, mask, garment, train, len(GARMENTS))

    def nearest(row: int) -> tuple[np.ndarray, np.ndarray]:
        (neighbour,) = nearest_rows(cvar, garment, train, [row])
        return offsets[neighbour], mask[neighbour]

    return {
        "mean_garment": lambda row: (mean.offsets[garment[row]], mean.mask[garment[row]]),
        "nearest_cvar": nearest,
    }


def static_baseline_summary(
    truth: Truth,
    garments: StaticRows,
    splits: Mapping[str, np.ndarray],
    pca: GarmentPca,
    *,
    seed: int,
) -> Table:
    """Metrics of the baselines, fitted to the training split, and of the ground truth itself.

    Args:
        splits: split -> rows to measure.
        pca: of the training rows.
    """
    predictors = garment_baselines(garments)
    predictors["pca"] = lambda row: pca.reconstruct(garments.offsets[row])
    found = []
    for split, rows in splits.items():
        measured = {"registered": measure_truth(truth, rows)}
        for name, predict in predictors.items():
            guessed = ((row, predict(row)) for row in progress(rows.tolist(), label=name))
            measured[name] = measure_predictions(truth, guessed)
        for name, measures in measured.items():
            found.append(
                summarise(
                    measured_at_rest(garments, rows, measures),
                    model="truth" if name == "registered" else "baseline",
                    variant=name,
                    split=split,
                    seed=seed,
                    stream=(name, split),
                    by_source=False,
                )
            )
    return join(found)
