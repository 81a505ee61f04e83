"""The long-form table of metrics: one row per model, split, garment and metric."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from drapeline.errors import InputError
from drapeline.metrics.metric import Measured
from drapeline.schema import Column, Schema, Table, check_table, make_table, read_table, write_table
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder

ALL = "all"
LOW, HIGH = "_low95", "_high95"
_RESAMPLES = 1000
# End of a metric's name -> unit.
_UNITS = {
    "_mm": "mm",
    "_deg": "deg",
    "_nat": "nat",
    "_m_s2": "m/s^2",
    "_s": "s",
    "_s_per_frame": "s",
}

# model: such as "svae" or "garment4d"; also "baseline", "representation", "scan" or "truth".
# variant: which of them, such as "svae_no_mask" or "mean_garment".
# garment: one of the garment types, a class of them, or "all".
# metric: a name that carries its unit; ends in `LOW` or `HIGH` for the ends of an interval.
# n: garments, frames of garments or sequences that the value is a mean over.
# seed: of the training, or of the experiment where nothing was trained.
# source: cloth solver that moved the garments measured; empty for garments of any source.
METRICS = Schema(
    "a table of metrics",
    {
        "model": Column(),
        "variant": Column(),
        "split": Column(allowed=("train", "val", "test", "scans")),
        "garment": Column(),
        "metric": Column(),
        "value": Column(float, text=".6g"),
        "unit": Column(),
        "n": Column(int, low=1),
        "seed": Column(int),
        "source": Column(),
    },
    key=("model", "variant", "split", "garment", "metric", "seed", "source"),
)


def summarise(
    measured: Sequence[Measured],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
    stream: Sequence[str] | None = None,
    by_source: bool = True,
    of_all: Mapping[str, float] | None = None,
) -> Table:
    """Means over garments of each type and over all, with 95 % intervals.

    Intervals come from 1000 bootstrap resamples of groups, since garments of one body, or pieces
    of one clip, are not independent. With fewer than three groups there are none. Where
    several solvers moved the garments there are rows of all and of each.

    Args:
        measured: garments or frames of a split by one variant; what is NaN is left out and not
            counted in `n`.
        seed: named in the rows; also draws the intervals.
        stream: names of the random stream of the intervals; by default model, variant and split.
        by_source: whether there are rows of each solver, and streams of their own.
        of_all: metric -> what is a measure of all garments together and no mean over them, such as
            how many components vary; has a row without an interval.
    """
    names = ("intervals", *(stream or (model, variant, split)))
    means = [
        (garment, name + end, value, n, source)
        for source, part in (_by_source(measured) if by_source else {"": measured}).items()
        for garment, name, values, n in _means(
            rng_for(seed, *names, *([source] if by_source else [])), part
        )
        for end, value in values.items()
    ]
    if measured:
        means += [(ALL, name, value, len(measured), "") for name, value in (of_all or {}).items()]
    rows = [
        {
            "model": model,
            "variant": variant,
            "split": split,
            "garment": garment,
            "metric": name,
            "value": value,
            "unit": unit_of(name),
            "n": n,
            "seed": seed,
            "source": source,
        }
        for garment, name, value, n, source in means
    ]
    return make_table(METRICS, rows)


def _by_source(measured: Sequence[Measured]) -> dict[str, Sequence[Measured]]:
    """All measures under "" and, where there are several sources, those of each under its name."""
    sources = sorted({one.source for one in measured})
    parts = {name: [one for one in measured if one.source == name] for name in sources}
    return {"": measured, **(parts if len(parts) > 1 else {})}


def _means(
    rng: np.random.Generator, measured: Sequence[Measured]
) -> Iterator[tuple[str, str, Mapping[str, float], int]]:
    """Garment, metric, its mean and the ends of the interval, and over how many values."""
    values = pd.DataFrame([one.measures for one in measured], dtype=np.float64)
    garments = np.array([one.garment for one in measured], dtype=object)
    groups = np.array([one.group for one in measured])
    for garment in (ALL, *dict.fromkeys(garments)) if len(measured) else ():
        chosen = (garments == garment) | (garment == ALL)
        for name in values:
            kept = chosen & values[name].notna().to_numpy()
            if kept.any():
                column = values[name].to_numpy()[kept]
                ends = _interval(rng, column, groups[kept])
                yield garment, name, {"": float(column.mean()), **ends}, int(kept.sum())


def _interval(rng: np.random.Generator, values: np.ndarray, groups: np.ndarray) -> dict[str, float]:
    _, group = np.unique(groups, return_inverse=True)
    counts = np.bincount(group)
    if len(counts) < 3:
        return {}
    resampled = rng.integers(len(counts), size=(_RESAMPLES, len(counts)))
    means = np.bincount(group, values)[resampled].sum(axis=1) / counts[resampled].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return {LOW: float(low), HIGH: float(high)}


def join(tables: Iterable[Table]) -> Table:
    """The rows of several tables of metrics, in their order."""
    return pd.concat([make_table(METRICS, []), *tables], ignore_index=True)


def without_all(table: Table) -> Table:
    """The rows of single types: tables of one type each are joined, which hold the same twice."""
    return table[table["garment"] != ALL]


def write_metrics(path: str | Path, table: Table) -> None:
    """Write rows as a tab-separated table.

    Raises:
        InputError: a value is not finite, a unit is not its metric's, or two rows have one key.
    """
    _check_units(table, path)
    write_table(path, table, METRICS)


def read_metrics(path: str | Path) -> Table:
    """Read what `write_metrics` wrote.

    Raises:
        InputError: the file is missing, has other columns, or holds a row that is no metric.
    """
    table = read_table(path, METRICS)
    _check_units(table, path)
    return table


def collect_metrics(path: str | Path, tables: Iterable[str | Path]) -> int:
    """Write the rows of several tables as one, in their order, and return how many there are.

    Raises:
        InputError: a table is unusable, or two of them hold the same row.
    """
    table = join(map(read_metrics, tables))
    write_metrics(path, table)
    return len(table)


def with_intervals(table: Table) -> Table:
    """A row for each value, with the ends of its interval as columns "low" and "high" or NaN."""
    key = list(METRICS.key)
    found = table.assign(low=np.nan, high=np.nan)
    is_end = found["metric"].str.endswith((LOW, HIGH))
    values = found[~is_end].set_index(key)
    for name, end in (("low", LOW), ("high", HIGH)):
        ends = table[table["metric"].str.endswith(end)]
        ends = ends.assign(metric=ends["metric"].str.removesuffix(end)).set_index(key)
        values[name] = ends["value"].reindex(values.index)
    return values.reset_index()[[*METRICS.columns, "low", "high"]]


def unit_of(metric: str) -> str:
    """Unit of a metric, which its name ends in; "1" for shares and counts."""
    name = metric.removesuffix(LOW).removesuffix(HIGH)
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "1")


def _check_units(table: Table, path: str | Path) -> None:
    check_table(METRICS, table, path)
    expected = table["metric"].map(unit_of)
    wrong = (table["unit"] != expected).to_numpy()
    if wrong.any():
        row = int(wrong.argmax())
        raise InputError(
            f"{path}: line {row + 2}: {table['metric'].iloc[row]} has the unit"
            f" '{table['unit'].iloc[row]}', expected '{expected.iloc[row]}'"
        )


# Of an evaluation's folder.
METRICS_FILE = "metrics.tsv"


def write_evaluation(
    folder: str | Path, rows: Table, complete: Callable[[Path], None] | None = None
) -> None:
    """Leave the folder of an evaluation.

    Args:
        folder: gets `metrics.tsv`.
        rows: see `METRICS`.
        complete: adds what figures are drawn from.
    """
    with atomic_folder(folder) as scratch:
        write_metrics(scratch / METRICS_FILE, rows)
        if complete is not None:
            complete(scratch)
