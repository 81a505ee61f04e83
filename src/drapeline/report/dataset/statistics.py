"""Figures of a dataset's content: garments, fabrics, actions, bodies, splits and sizes."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drapeline.dataset.record import SampleRecord, meta_path
from drapeline.dataset.splits import SPLITS
from drapeline.dataset.tables import read_table
from drapeline.errors import InputError
from drapeline.report.colours import BLUE, FABRIC_COLOURS, GENDER_COLOURS, QUIET, SERIES
from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message

_NOTHING = "No sample was accepted"
_ROW_IN = 0.34


def plot_garments(path: str | Path, dataset: str | Path) -> None:
    """Draw the garments of each type, divided by fabric."""
    rows = read_table(Path(dataset) / "samples.tsv", ("garments", "fabrics"))
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        worn = row["garments"].split("+"), row["fabrics"].split("+")
        if len(worn[0]) != len(worn[1]):
            raise InputError(
                f"{Path(dataset) / 'samples.tsv'}: garments '{row['garments']}' with fabrics"
                f" '{row['fabrics']}', expected one fabric for each garment"
            )
        for garment, fabric in zip(*worn, strict=True):
            counts[garment][fabric] += 1
    _stacked_bars(path, counts, FABRIC_COLOURS, "Garments")


def plot_actions(path: str | Path, dataset: str | Path) -> None:
    """Draw the share of the frames of each action label (CLOTH3D's table 2), the largest on top."""
    rows = read_table(Path(dataset) / "statistics_actions.tsv", ("action", "percent", "frames"))
    with saved_figure(path, height_in=1.2 + _ROW_IN * max(len(rows), 2)) as (_, (axes,)):
        if not rows:
            show_message(axes, _NOTHING)
            return
        shares = [float(row["percent"]) for row in rows]
        axes.barh(range(len(rows)), shares, color=BLUE, height=0.68)
        for place, (row, share) in enumerate(zip(rows, shares, strict=True)):
            text = f"{share:.1f} %, {row['frames']} frames"
            label_bar(axes, share, place, text)
        axes.set_yticks(range(len(rows)), [row["action"] for row in rows])
        axes.invert_yaxis()
        axes.set_xlim(0, 1.3 * max(shares))
        axes.set_xlabel("Share of the frames (%)")
        _quiet_rows(axes)


def plot_splits(path: str | Path, dataset: str | Path) -> None:
    """Draw the sequences of each split, divided by gender."""
    rows = read_table(Path(dataset) / "samples.tsv", ("split", "gender"))
    counts: dict[str, Counter[str]] = {split: Counter() for split in SPLITS} if rows else {}
    for row in rows:
        counts.setdefault(row["split"], Counter())[row["gender"]] += 1
    _stacked_bars(path, counts, GENDER_COLOURS, "Sequences", by_size=False)


def plot_bodies(path: str | Path, records: Sequence[SampleRecord]) -> None:
    """Draw body shapes and the tightness of clothes, with a dot for each sample."""
    with saved_figure(path, width_in=8.4, height_in=4.2, columns=2) as (_, axes):
        if not records:
            for each in axes:
                show_message(each, _NOTHING)
            return
        panels = {
            "Body": ("shape", "Shape 1 (deviations)", "Shape 2 (deviations)"),
            "Outfit": ("tightness", "Tightness 1", "Tightness 2"),
        }
        for each, (title, (key, x_label, y_label)) in zip(axes, panels.items(), strict=True):
            for gender, colour in GENDER_COLOURS.items():
                points = np.array(
                    [
                        _outfit_value(record, key)[:2]
                        for record in records
                        if record.meta["body"]["gender"] == gender
                    ]
                ).reshape(-1, 2)
                each.scatter(*points.T, s=46, color=colour, alpha=0.8, linewidths=0, label=gender)
            each.set(xlabel=x_label, ylabel=y_label)
            each.grid(True)
            each.locator_params(nbins=5)
            each.set_title(title, pad=22)
        place_legend_above(axes[0])


def plot_vertices(path: str | Path, records: Sequence[SampleRecord]) -> None:
    """Draw the vertices of garments by type: a dot for each garment and a line at the mean."""
    sizes: dict[str, list[int]] = defaultdict(list)
    for record in records:
        for name, garment in record.meta["garments"].items():
            sizes[name].append(garment["vertices"])
    names = sorted(sizes, key=lambda name: -np.mean(sizes[name]))
    with saved_figure(path, height_in=1.2 + _ROW_IN * max(len(names), 2)) as (_, (axes,)):
        if not names:
            show_message(axes, _NOTHING)
            return
        for place, name in enumerate(names):
            mean = np.mean(sizes[name])
            axes.plot(sizes[name], [place] * len(sizes[name]), "o", ms=7, color=BLUE, alpha=0.55,
                      markeredgewidth=0)  # fmt: skip
            axes.plot([mean, mean], [place - 0.32, place + 0.32], color=QUIET, lw=2)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.set_xlabel("Vertices per garment (line: mean of the type)")
        axes.xaxis.set_major_formatter("{x:,.0f}")
        _quiet_rows(axes)


def _outfit_value(record: SampleRecord, key: str) -> list[float]:
    values = record.meta["outfit"].get(key)
    if values is None or len(values) < 2:
        raise InputError(f"{meta_path(record.folder)}: outfit.{key} is {values}, expected list")
    return values


def _stacked_bars(
    path: str | Path,
    counts: Mapping[str, Mapping[str, int]],
    colours: Mapping[str, str],
    label: str,
    by_size: bool = True,
) -> None:
    """Draw a horizontal bar for each key of `counts`, divided by the inner keys."""
    names = list(counts)
    if by_size:
        names.sort(key=lambda name: (-sum(counts[name].values()), name))
    found = {part for parts in counts.values() for part in parts}
    parts = [*filter(found.__contains__, colours), *sorted(found - set(colours))]
    spare = iter(SERIES)
    with saved_figure(path, height_in=1.5 + _ROW_IN * max(len(names), 2)) as (_, (axes,)):
        if not names:
            show_message(axes, _NOTHING)
            return
        ends = np.zeros(len(names))
        for part in parts:
            widths = np.array([counts[name].get(part, 0) for name in names])
            colour = colours.get(part) or next(spare)
            axes.barh(range(len(names)), widths, left=ends, color=colour, height=0.68, label=part)
            ends += widths
        for place, end in enumerate(ends):
            label_bar(axes, end, place, str(int(end)))
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.1 * ends.max())
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_xlabel(label)
        _quiet_rows(axes)
        place_legend_above(axes)


def _quiet_rows(axes: Axes) -> None:
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")
