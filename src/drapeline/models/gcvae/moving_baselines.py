"""Predictions of garments in motion that need no network, and their metrics.

A prediction is wrinkles: offsets freed from the pose, which are added to the garment at rest before
it is skinned. All but PCA, which is given the frame, know only what moves the garment: poses, the
wearer, and the garment at rest, or its type alone.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.learning_data.moving import MovingGarment
from drapeline.learning_data.training_rows import linear_rows, with_mirror_images
from drapeline.metrics.baselines import fit_mean_garment, fit_pca
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import measure_inside, measure_motion, measured_in_motion
from drapeline.metrics.table import join, summarise
from drapeline.models.gcvae.data import DynamicGarments, cvar_statistics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import points_from_offsets
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress
from drapeline.schema import Table
from drapeline.storage import write_json

STILL, MEAN, MEAN_GARMENT = "skinned_static", "skinned_mean", "skinned_mean_garment"
RIDGE, PCA = "wrinkle_ridge", "wrinkle_pca"
PENALTIES = tuple(10.0**power for power in range(7))  # of the regression, counted in frames
RIDGE_FILE = "ridge.json"  # of an evaluation
_BLOCK = 256  # rows


@dataclass(frozen=True)
class WrinkleRidge:
    """A ridge regression of wrinkles on conditions, both as deviations from the mean of a type."""

    mean: np.ndarray  # (types, V, 3) metres
    cvar_mean: np.ndarray  # (types, C)
    cvar_std: np.ndarray  # (C,) over all types
    weights: np.ndarray  # (C, 3V) metres
    penalty: float  # that was chosen, counted in frames
    errors_mm: Mapping[float, float]  # penalty -> surface error on the validation frames

    def save(self, path: Path) -> None:
        """Write the penalty, and what every one reached, as JSON."""
        reached = {f"{penalty:g}": error for penalty, error in self.errors_mm.items()}
        write_json(path, {"penalty": self.penalty, "validation_surface_error_mm": reached})

    def predict(self, garment: np.ndarray, cvar: np.ndarray) -> np.ndarray:
        """Wrinkles (n, V, 3) of types (n,) in conditions (n, C), metres."""
        away = (cvar - self.cvar_mean[garment]) / self.cvar_std
        return self.mean[garment] + (away @ self.weights).reshape(len(away), -1, 3)


@dataclass(frozen=True)
class WrinkleRows:
    """Frames in memory."""

    offsets: np.ndarray  # (n, V, 3) metres, zero outside the mask
    mask: np.ndarray  # (n, V) bool
    cvar: np.ndarray  # (n, C) conditions
    garment: np.ndarray  # (n,) types


def read_rows(
    garments: DynamicGarments, split: str, mirror: np.ndarray | None, seed: int
) -> WrinkleRows:
    """Rows of a split and their mirror images, those that masked PPCA is fitted to.

    Args:
        mirror: (V,) vertices of the body that lie opposite; without it there are no images.
        seed: draws the rows, see `linear_rows`.

    Raises:
        InputError: there are none.
    """
    rows = linear_rows(garments, split, seed)
    if not len(rows):
        raise InputError(f"no sample of the {split} split was accepted, expected one or more")
    batches = with_mirror_images(garments, rows, mirror)
    types = garments.data.garment[garments.data.garment_index[rows]]
    return WrinkleRows(
        garment=np.tile(types, len(batches)),
        **{
            key: np.concatenate([each[key] for each in batches])
            for key in ("offsets", "mask", "cvar")
        },
    )


def fit_ridge(training: WrinkleRows, validation: WrinkleRows) -> WrinkleRidge:
    """Fit by every one of `PENALTIES`, and keep what errs least on the validation frames."""
    types, every = training.garment, np.arange(len(training.garment))
    mean = fit_mean_garment(training.offsets, training.mask, types, every, len(GARMENTS)).offsets
    overall, std = cvar_statistics(training.cvar)
    cvar_mean = np.stack(
        [
            training.cvar[types == kind].mean(axis=0) if (types == kind).any() else overall
            for kind in range(len(GARMENTS))
        ]
    )
    conditions, seen = (
        ((rows.cvar - cvar_mean[rows.garment]) / std).astype(np.float32)  # (n, C)
        for rows in (training, validation)
    )
    width = 3 * training.mask.shape[1]
    cross = np.zeros((conditions.shape[1], width), dtype=np.float32)
    for start in range(0, len(conditions), _BLOCK):
        part = slice(start, start + _BLOCK)
        away = training.offsets[part] - mean[types[part]]
        away *= training.mask[part][..., None]
        cross += conditions[part].T @ away.reshape(len(away), -1)
    # With C^T C = U s U^T, the weights are U (s + penalty)^-1 U^T C^T Y for every penalty.
    wide = conditions.astype(np.float64)
    sizes, axes = np.linalg.eigh(wide.T @ wide)
    turned = axes.T.astype(np.float32) @ cross
    errors = {
        penalty: _error_mm(seen @ axes / (sizes + penalty), turned, mean, validation)
        for penalty in PENALTIES
    }
    best = min(errors, key=errors.__getitem__)
    weights = (axes / (sizes + best)).astype(np.float32) @ turned
    return WrinkleRidge(mean, cvar_mean, std, weights, best, errors)


def _error_mm(
    factors: np.ndarray, turned: np.ndarray, mean: np.ndarray, true: WrinkleRows
) -> float:
    """Mean over frames of the mean distance within the mask."""
    errors = []
    for start in range(0, len(factors), _BLOCK):
        part = slice(start, start + _BLOCK)
        made = (factors[part].astype(np.float32) @ turned).reshape(-1, *mean.shape[1:])
        made += mean[true.garment[part]]
        mask = true.mask[part]
        away = np.linalg.norm(made - true.offsets[part], axis=2) * mask
        errors.append(away.sum(axis=1) / mask.sum(axis=1))
    return float(1000 * np.concatenate(errors).mean())


class MovingBaselines:
    """All predictions, fitted to training frames.

    Args:
        garments: of the version "unposed".
        mirror: (V,) vertices of the body that lie opposite; None if it is not symmetric.
        components: of the PCA, at most.
        seed: draws the frames, see `linear_rows`.

    Attributes:
        ridge: the regression, with what chose its penalty.

    Raises:
        InputError: there are no training or no validation frames.
    """

    def __init__(
        self, garments: DynamicGarments, mirror: np.ndarray | None, *, components: int, seed: int
    ) -> None:
        self.data, self._garments = garments.data, garments
        training = read_rows(garments, "train", mirror, seed)
        # Each garment once, whatever the length of its motion.
        trained = np.flatnonzero(self.data.split == "train")
        still = fit_mean_garment(
            self.data.static, self.data.mask, self.data.garment, trained, len(GARMENTS)
        )
        self._mean_garment = still.offsets
        self.ridge = fit_ridge(training, read_rows(garments, "val", None, seed))
        self._pca = fit_pca(training.offsets, training.mask, components)

    def wrinkles(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Name -> offsets (n, V, 3) in metres of frames from the true garment at rest."""
        data = self.data
        garments, true = data.garment_index[rows], np.asarray(data.offsets[rows])
        types = data.garment[garments]
        mean = self.ridge.mean[types]
        return {
            STILL: np.zeros_like(true),
            MEAN: mean,
            MEAN_GARMENT: self._mean_garment[types] + mean - data.static[garments],
            RIDGE: self.ridge.predict(types, self._garments.cvar(rows)),
            PCA: np.stack([self._pca.reconstruct(one)[0] for one in true]),
        }


def moving_baseline_summary(
    baselines: MovingBaselines,
    held_out: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    *,
    seed: int,
) -> Table:
    """Metrics of the baselines, and of the ground truth itself.

    Args:
        held_out: split -> garments to measure.
        bodies: super-resolved, by gender.
    """
    data, found = baselines.data, []
    for split, garments in held_out.items():
        measured: dict[str, list[Measured]] = {}
        for moving in progress(garments, label=split):
            rows, body = data.rows_of(moving.sample, moving.name), bodies[moving.gender]
            frames = data.frame[rows]
            inside = measure_inside(moving, frames, moving.points(frames), body, topology)
            measured.setdefault("moving", []).extend(measured_in_motion(moving, inside))
            for name, offsets in baselines.wrinkles(rows).items():
                points = points_from_offsets(
                    moving.registered, offsets, body, moving.shape, moving.poses[frames], "unposed"
                )
                measures = measure_motion(moving, frames, points, body, topology)
                measured.setdefault(name, []).extend(measured_in_motion(moving, measures))
        for name, every in measured.items():
            model = "truth" if name == "moving" else "baseline"
            found.append(
                summarise(
                    every, model=model, variant=name, split=split, seed=seed, stream=(name, split)
                )
            )
    return join(found)
