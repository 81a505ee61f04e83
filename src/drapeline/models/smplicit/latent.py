"""SMPLicit's codes: samples, interpolations, principal axes, prototypes and edits (3.4 and 4.1).

N codes of Z numbers each, z_cut followed by z_style; P properties, see `metrics.properties`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drapeline.errors import InputError

# Singular values below this share of the largest are taken for zero.
_NEGLIGIBLE = 1e-6
_SIMILAR = 5  # garments that a new one may lie next to


@dataclass(frozen=True)
class CodeGaussian:
    """A normal distribution of codes."""

    mean: np.ndarray  # (Z,)
    directions: np.ndarray  # (K, Z) orthonormal rows
    deviations: np.ndarray  # (K,) standard deviation along each; there is none across them

    @property
    def covariance(self) -> np.ndarray:
        """(Z, Z) covariance."""
        scaled = self.deviations[:, None] * self.directions
        return scaled.T @ scaled

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(count, Z) codes."""
        return self.codes(rng.normal(size=(count, len(self.deviations))))

    def codes(self, scores: np.ndarray) -> np.ndarray:
        """Codes (..., Z) at scores (..., K): how many deviations they are off the mean."""
        return self.mean + scores * self.deviations @ self.directions

    def scores(self, codes: np.ndarray) -> np.ndarray:
        """Scores (..., K) of codes (..., Z); zero along directions without deviation."""
        along = (codes - self.mean) @ self.directions.T
        known = self.deviations > 0
        return np.divide(along, self.deviations, out=np.zeros_like(along), where=known)

    def walk(self, direction: int, scores: Sequence[float]) -> np.ndarray:
        """(len(scores), Z) codes along a single direction."""
        every = np.zeros((len(scores), len(self.deviations)))
        every[:, direction] = scores
        return self.codes(every)


def single_gaussian(codes: np.ndarray) -> CodeGaussian:
    """N(mu 1, sigma I), with one mean and one deviation for all numbers of all codes (3.4).

    Args:
        codes: (N, Z) of the training garments.

    Raises:
        InputError: fewer than two codes, or a number that is not finite.
    """
    codes = _checked(codes)
    size = codes.shape[1]
    return CodeGaussian(np.full(size, codes.mean()), np.eye(size), np.full(size, codes.std(ddof=1)))


def principal_gaussian(codes: np.ndarray, count: int | None = None) -> CodeGaussian:
    """The normal distribution of codes, along their principal axes, the widest first.

    Its draws keep what training garments have in common, unlike those of `single_gaussian`. Of each
    axis, the number with the largest magnitude is positive.

    Args:
        codes: (N, Z) of the training garments.
        count: of numbers, from the first, that vary; z_cut's in 4.1. The others stay at their mean.

    Raises:
        InputError: fewer than two codes, or a number that is not finite.
    """
    codes = _checked(codes)
    mean = codes.mean(axis=0)
    away = codes - mean
    if count is not None:
        away[:, count:] = 0
    _, lengths, axes = np.linalg.svd(away, full_matrices=False)
    kept = lengths > _NEGLIGIBLE * max(lengths[0], np.abs(codes).max())
    lengths, axes = lengths[kept], axes[kept]
    largest = np.abs(axes).argmax(axis=1)
    axes *= np.sign(axes[np.arange(len(axes)), largest])[:, None]
    return CodeGaussian(mean, axes, lengths / np.sqrt(len(codes) - 1))


def draw_between(
    codes: np.ndarray, kinds: np.ndarray, rng: np.random.Generator, count: int
) -> np.ndarray:
    """Codes of new garments, each on the line between two similar training garments.

    The second one is one of the `_SIMILAR` of the same kind whose codes are nearest to the first
    one's, as in SMOTE (Chawla et al. 2002). Garments of a kind are few for the length of their
    codes; a normal distribution, which knows no more of them than mean and covariance, also gives
    codes between kinds of cut, whose garments are torn.

    Args:
        codes: (N, Z) of the training garments.
        kinds: (N,) of these.

    Returns:
        (count, Z).

    Raises:
        InputError: fewer than two codes, or a number that is not finite.
    """
    codes, drawn = _checked(codes), []
    for _ in range(count):
        first = rng.integers(len(codes))
        away = np.where(kinds == kinds[first], np.linalg.norm(codes - codes[first], axis=1), np.inf)
        similar = np.argsort(away)[: 1 + min(_SIMILAR, int(np.isfinite(away).sum()) - 1)]
        second = rng.choice(similar[1:]) if len(similar) > 1 else first
        drawn.append(codes[first] + rng.uniform() * (codes[second] - codes[first]))
    return np.array(drawn).reshape(count, codes.shape[1])


def interpolate(start: np.ndarray, end: np.ndarray, steps: int) -> np.ndarray:
    """(steps, Z) codes at even distances on the line between two, ends included.

    Raises:
        InputError: fewer than two steps, or codes of different lengths.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if steps < 2:
        raise InputError(f"steps: {steps}, expected at least 2")
    if start.shape != end.shape:
        raise InputError(f"codes of {start.size} and {end.size} numbers, expected equal lengths")
    share = np.linspace(0, 1, steps)[:, None]
    return (1 - share) * start + share * end


def correlations(scores: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Pearson's correlation of each column of scores with each of values.

    Args:
        scores: (N, K).
        values: (N, P) with NaN where a garment lacks a property, as which it does not count.

    Returns:
        (K, P); NaN where fewer than three garments are left or one of the columns is constant.
    """
    found = np.full((scores.shape[1], values.shape[1]), np.nan)
    for column, value in enumerate(values.T):
        known = np.isfinite(value)
        if known.sum() < 3:
            continue
        away = value[known] - value[known].mean()
        moved = scores[known] - scores[known].mean(axis=0)
        size = np.linalg.norm(moved, axis=0) * np.linalg.norm(away)
        varies = size > _NEGLIGIBLE**2
        found[varies, column] = (away @ moved)[varies] / size[varies]
    return found


def group_means(codes: np.ndarray, groups: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Mean codes of groups (N,) of codes (N, Z): the paper's prototypes (4.1); none if empty."""
    return {name: codes[chosen].mean(axis=0) for name, chosen in groups.items() if chosen.any()}


class PropertyEdits:
    """Changes of single properties of a garment, by linear regression of properties on codes.

    An edit takes the regression of its property along by what was asked, those of the others
    not at all, and of all changes of the code that do so, it is the one that is least unlikely
    among the codes of training garments: the shortest in deviations of their distribution.

    Args:
        codes: (N, Z) of the training garments.
        values: name -> (N,) of a property, with NaN where a garment lacks it.

    Attributes:
        slopes: (P, Z) change of each property per unit of each number.

    Raises:
        InputError: fewer than two codes, a number that is not finite, or a property that fewer than
            two garments have.
    """

    def __init__(self, codes: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        codes = _checked(codes)
        self.names = tuple(values)
        fits = [_regression(name, codes, value) for name, value in values.items()]
        self._at_zero = np.array([fit[0] for fit in fits])
        self.slopes = np.stack([fit[1] for fit in fits])
        towards = principal_gaussian(codes).covariance @ self.slopes.T  # (Z, P)
        shared = self.slopes @ towards  # covariance of the regressions
        # Properties have units of their own, so it is the correlations that are inverted.
        size = np.sqrt(np.maximum(np.diag(shared), np.finfo(float).tiny))
        inverse = np.linalg.pinv(shared / np.outer(size, size), rcond=_NEGLIGIBLE)
        self._steps = towards @ (inverse / np.outer(size, size))

    def predict(self, codes: np.ndarray) -> np.ndarray:
        """(..., P) properties of codes (..., Z) by the regressions."""
        return self._at_zero + codes @ self.slopes.T

    def step(self, name: str) -> np.ndarray:
        """(Z,) change of a code that raises a property by one and leaves the others.

        Raises:
            InputError: there is no such property, or codes do not tell it from the others.
        """
        if name not in self.names:
            raise InputError(f"property: '{name}', expected one of {', '.join(self.names)}")
        index = self.names.index(name)
        wanted = np.eye(len(self.names))[index]
        step = self._steps[:, index]
        if not np.allclose(self.slopes @ step, wanted, atol=1e-3):
            raise InputError(
                f"property: '{name}' cannot be changed by itself, expected codes in which it varies"
                " apart from the other properties"
            )
        return step

    def edit(self, z: np.ndarray, changes: Mapping[str, float]) -> np.ndarray:
        """A code (Z,) with some properties changed by so much, and the others kept."""
        return z + sum(change * self.step(name) for name, change in changes.items())


def explained_share(codes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Share of each property's variance that codes predict of garments that are left out.

    Args:
        codes: (N, Z).
        values: (N, P) with NaN where a garment lacks a property.

    Returns:
        (P,) 1 minus the mean squared leave-one-out error of the linear regression, divided by the
        variance; NaN where there are not more garments than twice the numbers of a code.
    """
    shares = np.full(values.shape[1], np.nan)
    for column, value in enumerate(values.T):
        known = np.isfinite(value)
        if known.sum() <= 2 * codes.shape[1] or np.ptp(value[known]) == 0:
            continue
        given = _with_constant(codes[known])
        hat = given @ np.linalg.pinv(given)
        left_out = (value[known] - hat @ value[known]) / (1 - np.diag(hat))
        shares[column] = 1 - np.mean(left_out**2) / value[known].var()
    return shares


def _regression(name: str, codes: np.ndarray, value: np.ndarray) -> tuple[float, np.ndarray]:
    """Value at the code 0, and slopes (Z,), by least squares with the shortest slopes."""
    known = np.isfinite(value)
    if known.sum() < 2:
        raise InputError(f"property: {known.sum()} garments have '{name}', expected two or more")
    middle = codes[known].mean(axis=0)
    mean = value[known].mean()
    slopes = np.linalg.lstsq(codes[known] - middle, value[known] - mean, rcond=_NEGLIGIBLE)[0]
    return mean - middle @ slopes, slopes


def _with_constant(codes: np.ndarray) -> np.ndarray:
    return np.hstack([np.ones((len(codes), 1)), codes])


def _checked(codes: np.ndarray) -> np.ndarray:
    codes = np.array(codes, dtype=np.float64)
    if codes.ndim != 2 or len(codes) < 2:
        raise InputError(f"codes: shape {codes.shape}, expected two codes or more, one in each row")
    if not np.isfinite(codes).all():
        raise InputError("codes: a number is not finite, expected finite ones")
    return codes
