"""The long-form table of metrics: one row per model, split, garment and metric."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from drapeline.errors import InputError
from drapeline.storage import atomic_file, read_rows

ALL = "all"
LOW, HIGH = "_low95", "_high95"
_RESAMPLES = 1000


# Metric -> unit; "1" for shares and counts.
UNITS = {
    "surface_error_mm": "mm",
    "normal_error_deg": "deg",
    "mask_iou": "1",
    "kl_nat": "nat",
    "predicted_to_true_mm": "mm",
    "true_to_predicted_mm": "mm",
    "inside_share": "1",
    "inside_1cm_share": "1",
    "inside_depth_mm": "mm",
    "area_ratio": "1",
    "pieces": "1",
    "surface_to_true_mm": "mm",
    "true_to_surface_mm": "mm",
    "code_numbers": "1",
    "field_near_mm": "mm",
    "field_space_mm": "mm",
    "walls_to_true_mm": "mm",
    "true_to_walls_mm": "mm",
    "openings_right": "1",
    "canonical_error_mm": "mm",
    "canonical_to_original_mm": "mm",
    "vertex_error_mm": "mm",
    "acceleration_error_m_s2": "m/s^2",
    "to_cloud_mm": "mm",
    "segmentation_accuracy": "1",
    "silhouette_iou": "1",
    "better_than_mean_share": "1",
    "fit_s": "s",
    "inference_s_per_frame": "s",
}


class MetricRow(NamedTuple):
    """One number.

    Attributes:
        model: such as "svae" or "garment4d"; also "baseline", "representation" or "truth".
        variant: which of them, such as "svae_no_mask" or "mean_garment"; of one model only.
        split: "train", "val" or "test", or "scans" of a user.
        garment: one of the garment types, or "all".
        metric: a name that carries its unit; ends in `LOW` or `HIGH` for the ends of an interval.
        value: finite.
        unit: one of `UNITS`.
        n: garments, frames of garments or sequences that the value is a mean over.
        seed: of the training, or of the experiment where nothing was trained.
        source: cloth solver that moved the garments measured; empty for garments of any source.
    """

    model: str
    variant: str
    split: str
    garment: str
    metric: str
    value: float
    unit: str
    n: int
    seed: int
    source: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """Identifies a row in a table."""
        return (*self[:5], str(self.seed), self.source)


def summary_rows(
    rng: np.random.Generator,
    measures: Sequence[Mapping[str, float]],
    garments: Sequence[str],
    groups: Sequence[str],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
    source: str = "",
) -> list[MetricRow]:
    """Means over garments of each type and over all, with 95 % intervals.

    Intervals come from 1000 bootstrap resamples of groups, since garments of one body, or frames
    of one sequence, are not independent. With fewer than three groups there are none.

    Args:
        rng: draws the resamples.
        measures: a mapping, metric -> value, per garment or frame; NaN is left out and not
            counted in `n`.
        garments: its type, per garment or frame.
        groups: what makes values dependent, such as the outfit or the sequence, likewise.
    """
    if not measures:
        return []
    garments, groups = np.asarray(garments), np.asarray(groups)
    names = list(dict.fromkeys(name for row in measures for name in row))
    table = {name: np.array([row.get(name, np.nan) for row in measures]) for name in names}
    rows = []
    for garment in (ALL, *dict.fromkeys(garments.tolist())):
        chosen = np.ones(len(garments), dtype=bool) if garment == ALL else garments == garment
        for name, values in table.items():
            kept = chosen & ~np.isnan(values)
            if not kept.any():
                continue
            numbers = {"": float(values[kept].mean())}
            interval = _interval(rng, values[kept], groups[kept])
            if interval:
                numbers |= {LOW: interval[0], HIGH: interval[1]}
            rows += [
                MetricRow(
                    model,
                    variant,
                    split,
                    garment,
                    name + end,
                    value,
                    UNITS[name],
                    int(kept.sum()),
                    seed,
                    source,
                )
                for end, value in numbers.items()
            ]
    return rows


class _HasSource(Protocol):
    source: str


_Measured = TypeVar("_Measured", bound=_HasSource)


def by_source(measured: Sequence[_Measured]) -> dict[str, Sequence[_Measured]]:
    """What was measured, under "" all of it and, where there are several, under each source."""
    sources = sorted({one.source for one in measured})
    parts = {name: [one for one in measured if one.source == name] for name in sources}
    return {"": measured, **(parts if len(parts) > 1 else {})}


def _interval(
    rng: np.random.Generator, values: np.ndarray, groups: np.ndarray
) -> tuple[float, float] | None:
    _, group = np.unique(groups, return_inverse=True)
    counts = np.bincount(group)
    if len(counts) < 3:
        return None
    resampled = rng.integers(len(counts), size=(_RESAMPLES, len(counts)))
    means = np.bincount(group, values)[resampled].sum(axis=1) / counts[resampled].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def write_metrics(path: str | Path, rows: Iterable[MetricRow]) -> None:
    """Write rows as a tab-separated table.

    Raises:
        InputError: a value is not finite, a unit is not its metric's, or two rows have one key.
    """
    rows = list(rows)
    _check(rows, path)
    with atomic_file(path) as scratch, open(scratch, "w", newline="") as stream:
        writer = csv.writer(stream, delimiter="\t", lineterminator="\n")
        writer.writerow(MetricRow._fields)
        writer.writerows(row._replace(value=f"{row.value:.6g}") for row in rows)


def read_metrics(path: str | Path) -> list[MetricRow]:
    """Read what `write_metrics` wrote.

    Raises:
        InputError: the file is missing, has other columns, or holds a row that is no metric.
    """
    path = Path(path)
    header, lines = read_rows(path, "a table of metrics")
    if tuple(header) != MetricRow._fields:
        raise InputError(
            f"{path}: has the columns {', '.join(header) or 'none'},"
            f" expected {', '.join(MetricRow._fields)}"
        )
    rows = []
    for number, line in enumerate(lines, 2):
        try:
            *words, value, unit, n, seed, source = line.values()
            rows.append(MetricRow(*words, float(value), unit, int(n), int(seed), source))
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{path}: line {number} is no row of metrics: {' '.join(line.values()):.200}"
            ) from error
    _check(rows, path)
    return rows


def collect_metrics(path: str | Path, tables: Iterable[str | Path]) -> int:
    """Write the rows of several tables as one, in their order, and return how many there are.

    Raises:
        InputError: a table is unusable, or two of them hold the same row.
    """
    rows = [row for table in tables for row in read_metrics(table)]
    write_metrics(path, rows)
    return len(rows)


def _check(rows: Sequence[MetricRow], path: str | Path) -> None:
    seen: set[tuple[str, ...]] = set()
    for row in rows:
        name = row.metric.removesuffix(LOW).removesuffix(HIGH)
        where = f"{path}: {row.variant} {row.split} {row.garment} {row.metric}"
        if not math.isfinite(row.value):
            raise InputError(f"{where} is {row.value}, expected a finite number")
        if UNITS.get(name) != row.unit:
            raise InputError(f"{where} has the unit '{row.unit}', expected '{UNITS.get(name)}'")
        if row.n < 1:
            raise InputError(f"{where} has n = {row.n}, expected at least 1")
        if row.key in seen:
            raise InputError(f"{where} is there twice, expected once")
        seen.add(row.key)


def find_value(
    rows: Iterable[MetricRow], variant: str, split: str, garment: str, metric: str, source: str = ""
) -> MetricRow | None:
    """The first row of that name and source, of any seed, or None."""
    wanted = (variant, split, garment, metric)
    return next((row for row in rows if row[1:5] == wanted and row.source == source), None)
