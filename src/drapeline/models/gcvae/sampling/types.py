"""What the codes and masks of each garment type are like.

A code has to be decoded on one of two topologies, so its type must be known first. Each type is a
Gaussian with the mean of its training codes and a covariance common to all types; the masks that
a code decodes to tell types apart where codes do not. New codes of a type come from a smoothed
bootstrap of its training codes (Silverman, "Density estimation", 1986, 6.4): a Gaussian as wide as
the type has most of its mass where hems of several lengths mix, and no garment is like that.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.models.gcvae.static_files import TrainingCodes, load_training_codes
from drapeline.outfits.garment_types import GARMENTS

_SHRINKAGE = 0.05  # of the covariance towards a multiple of the identity
_BANDWIDTH = 0.4  # of the smoothed bootstrap, in deviations of a type
_RATE_FLOOR = 0.01  # a vertex that no training garment covers is unlikely, not impossible


@dataclass(frozen=True)
class GarmentTypes:
    """Statistics of the training garments of each of K types, in the order of `GARMENTS`.

    Attributes:
        share: (K,) of the training garments, 0 for a type that none of them has.
        mean: (K, Z) of the codes.
        factor: (Z, Z) lower Cholesky factor of the codes' covariance within a type.
        codes, garment: (n, Z) and (n,) of the training garments, indices into `GARMENTS`.
        mask_rate: (K, V) share of the type's garments that cover a vertex.
    """

    share: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    codes: np.ndarray
    garment: np.ndarray
    mask_rate: np.ndarray

    def draw(self, rng: np.random.Generator, garment: str) -> np.ndarray:
        """Draw a code (Z,) near that of one of a type's garments; their mean is the type's.

        Raises:
            InputError: no training garment is of that type.
        """
        garment_index = GARMENTS.index(garment)
        if not self.share[garment_index]:
            known = ", ".join(np.array(GARMENTS)[self.share > 0])
            raise InputError(f"no training garment is a {garment}, expected one of {known}")
        mean = self.mean[garment_index]
        near = self.codes[rng.choice(np.flatnonzero(self.garment == garment_index))] - mean
        noise = self.factor @ rng.standard_normal(len(mean))
        return smooth_bootstrap(mean, near, noise)

    def log_likelihood(self, z: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """(n, K) of each type, given codes (n, Z) and the masks (n, K, V) decoded for each type.

        The vertices of a mask err alike, so all of them together count as much as the Z numbers.
        """
        away = np.linalg.solve(self.factor, (z[:, None] - self.mean).reshape(-1, z.shape[1]).T)
        by_code = -(away**2).sum(axis=0).reshape(len(z), -1) / 2
        rate = np.clip(self.mask_rate, _RATE_FLOOR, 1 - _RATE_FLOOR)
        by_vertex = np.where(mask, np.log(rate), np.log(1 - rate))
        known = self.share > 0
        prior = np.where(known, np.log(np.where(known, self.share, 1)), -np.inf)
        return prior + by_code + z.shape[1] * by_vertex.mean(axis=2)


def smooth_bootstrap(mean: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """A smoothed bootstrap that keeps mean and covariance.

    Args:
        mean: (Z,) of the codes.
        near: (..., Z) deviation from the mean of a training code.
        noise: (..., Z) deviation of another code of the same distribution.
    """
    return mean + np.sqrt(1 - _BANDWIDTH**2) * near + _BANDWIDTH * noise


def fit_types(training: TrainingCodes) -> GarmentTypes:
    """Estimate the types from the training garments of a model."""
    codes, garment, rate = training
    count = np.bincount(garment, minlength=len(GARMENTS))
    mean = np.zeros((len(GARMENTS), codes.mean.shape[1]))
    np.add.at(mean, garment, codes.mean)
    mean /= np.maximum(count, 1)[:, None]
    away = codes.mean - mean[garment]
    within = away.T @ away / len(away) + np.diag(np.exp(codes.log_variance).mean(axis=0))
    # With about as many garments as dimensions the covariance alone would be near singular.
    even = np.trace(within) / len(within) * np.eye(len(within))
    factor = np.linalg.cholesky((1 - _SHRINKAGE) * within + _SHRINKAGE * even)
    return GarmentTypes(count / count.sum(), mean, factor, codes.mean, garment, rate)


def load_types(folder: str | Path) -> GarmentTypes:
    """Types of the training garments of the static model in a folder.

    Raises:
        InputError: see `load_training_codes`.
    """
    return fit_types(load_training_codes(folder))
