"""Contents of a dataset: figures, and tables 1 and 2 of the CLOTH3D paper beside its own.

The paper's numbers describe other data: they are marked and stand in a column of their own.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from drapeline.dataset.record import SPLITS, SampleRecord, meta_path
from drapeline.dataset.statistics import NO_ACTION
from drapeline.dataset.tables import ACTIONS, OVERVIEW, SAMPLES
from drapeline.errors import InputError
from drapeline.report.colours import BLUE, FABRIC_COLOURS, GENDER_COLOURS, QUIET, SERIES
from drapeline.report.html import Cell, number
from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message
from drapeline.report.tables import Section, write_sections
from drapeline.schema import read_table

_NOTHING = "No sample was accepted"
_ROW_IN = 0.34
OURS = "This dataset"
THEIRS = "CLOTH3D, as printed"

# Bertiche, Madadi and Escalera, CLOTH3D: Clothed 3D Humans, ECCV 2020.
_PRINTED_FEATURES = 12  # of the rows of table 1; its text has the others
_TABLE_2 = {
    "Walk": 27.49, "Animal": 10.79, "Fight": 4.38, "Jump": 2.78, "Run": 2.49, "Sing": 2.38,
    "Wait": 2.31, "Swim": 1.97, "Story": 1.70, "Sports": 1.63, "Dance": 1.37, "Yoga": 1.01,
    "Spin": 0.90, "Exercise": 0.84, "Climb": 0.71, "Carry": 0.67, "Stand": 0.66, "Wash": 0.63,
    "Balancing": 0.54, "Trick": 0.51, "Sit": 0.28, "Interact": 0.20, "Drink": 0.14, "Pose": 0.14,
    "Bend": 0.12, "Others": 33.36,
}  # fmt: skip


def plot_garments(path: str | Path, dataset: str | Path) -> None:
    """Draw the garments of each type, divided by fabric."""
    table = Path(dataset) / "samples.tsv"
    samples = read_table(table, SAMPLES)
    worn = samples[["garments", "fabrics"]].map(lambda names: names.split("+"))
    uneven = worn["garments"].map(len) != worn["fabrics"].map(len)
    if uneven.any():
        row = samples[uneven].iloc[0]
        raise InputError(
            f"{table}: garments '{row['garments']}' with fabrics '{row['fabrics']}', expected one"
            " fabric for each garment"
        )
    worn = worn.explode(["garments", "fabrics"])
    counts = pd.crosstab(worn["garments"], worn["fabrics"])
    by_size = sorted(counts.index, key=lambda name: (-counts.loc[name].sum(), name))
    _stacked_bars(path, counts.loc[by_size], FABRIC_COLOURS, "Garments")


def plot_actions(path: str | Path, dataset: str | Path) -> None:
    """Draw the share of the frames of each action label (CLOTH3D's table 2), the largest on top."""
    actions = read_table(Path(dataset) / "statistics_actions.tsv", ACTIONS)
    with saved_figure(path, height_in=1.2 + _ROW_IN * max(len(actions), 2)) as (_, (axes,)):
        if not len(actions):
            show_message(axes, _NOTHING)
            return
        axes.barh(range(len(actions)), actions["percent"], color=BLUE, height=0.68)
        for row in actions.itertuples():
            text = f"{row.percent:.1f} %, {row.frames} frames"
            label_bar(axes, row.percent, row.Index, text)
        axes.set_yticks(range(len(actions)), actions["action"])
        axes.invert_yaxis()
        axes.set_xlim(0, 1.3 * actions["percent"].max())
        axes.set_xlabel("Share of the frames (%)")
        _quiet_rows(axes)


def plot_splits(path: str | Path, dataset: str | Path) -> None:
    """Draw the sequences of each split, divided by gender."""
    samples = read_table(Path(dataset) / "samples.tsv", SAMPLES)
    counts = pd.crosstab(samples["split"], samples["gender"])
    if len(samples):
        counts = counts.reindex(SPLITS, fill_value=0)
    _stacked_bars(path, counts, GENDER_COLOURS, "Sequences")


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
                each.scatter(
                    points[:, 0],
                    points[:, 1],
                    s=46,
                    color=colour,
                    alpha=0.8,
                    linewidths=0,
                    label=gender,
                )
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
    path: str | Path, counts: pd.DataFrame, colours: Mapping[str, str], label: str
) -> None:
    """Draw a horizontal bar for each row of counts, divided by its columns."""
    parts = [*filter(set(counts).__contains__, colours), *sorted(set(counts) - set(colours))]
    spare = iter(SERIES)
    with saved_figure(path, height_in=1.5 + _ROW_IN * max(len(counts), 2)) as (_, (axes,)):
        if not len(counts):
            show_message(axes, _NOTHING)
            return
        places, ends = range(len(counts)), np.zeros(len(counts))
        for part in parts:
            widths = counts[part].to_numpy()
            colour = colours.get(part) or next(spare)
            axes.barh(places, widths, left=ends, color=colour, height=0.68, label=part)
            ends += widths
        for place, end in enumerate(ends):
            label_bar(axes, end, place, str(int(end)))
        axes.set_yticks(places, counts.index)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.1 * ends.max())
        axes.locator_params(axis="x", integer=True)
        axes.set_xlabel(label)
        _quiet_rows(axes)
        place_legend_above(axes)


def _quiet_rows(axes: Axes) -> None:
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")


def write_paper_tables(path: str | Path, dataset: str | Path) -> None:
    """Write the page with tables 1 and 2.

    Raises:
        InputError: the dataset's statistics are missing or lack a column.
    """
    dataset = Path(dataset)
    overview = read_table(dataset / "statistics_overview.tsv", OVERVIEW)
    actions = read_table(dataset / "statistics_actions.tsv", ACTIONS)
    about = (
        "Shaded columns hold the numbers that the paper prints for its own dataset. They say how"
        " large and varied the original is; they are not a target, and nothing here was computed"
        " from its data."
    )
    labels = (
        "Labels follow the paper's where the motion is the same; a dash means that the dataset has"
        " no such label."
    )
    sections = [
        Section("Table 1: what the dataset holds", _table_1(overview.set_index("measure"))),
        Section("More of this dataset, by split", _by_split(overview)),
        Section("Table 2: share of the frames per action label", _table_2(actions), labels),
    ]
    write_sections(path, "Tables 1 and 2 of CLOTH3D, for this dataset", [about], sections)


def _table_1(measures: pd.DataFrame) -> list[dict[str, str]]:
    def ours(measure: str, part: str = "all") -> str:
        return measures[part].get(measure, "-")

    frames = int(ours("frames")) if ours("frames").isdigit() else 0
    splits = f"{ours('sequences', 'train')} : {ours('sequences', 'val')} (validation) : "
    features = (  # title, ours, theirs
        ("Resolution (mean edge length)", f"{ours('edge length (mm)')} mm", "1cm"),
        ("Missing data", "x", "x"),
        ("Dynamics", "✓", "✓"),
        ("Garments", f"{ours('garments')} of {ours('garment types')} types", "~9.6K"),
        ("Fabrics known", f"✓ ({ours('fabrics')})", "✓"),
        ("Variety of poses", f"{ours('actions')} actions of {ours('motion clips')} clips", "High"),
        ("Subjects (body shapes)", ours("subjects (bodies)"), "7.2K"),
        ("Layered garments", f"✓ ({ours('layered outfits')} of {ours('sequences')} outfits)", "✓"),
        ("Frames", f"{frames:,}", "2.1M"),
        ("Origin", "Synth.", "Synth."),
        ("Colour images", "✓", "x"),
        ("Error of the ground truth", "None", "None"),
        ("Sequences", ours("sequences"), "over 7000"),
        ("Female to male", f"{ours('female')}:{ours('male')}", "2:1"),
        ("Vertices per outfit", ours("vertices per outfit"), "around 20K"),
        ("Megabytes per sequence", ours("megabytes per sequence"), "35 to 40"),
        ("Training : test", splits + ours("sequences", "test"), "80 : 20"),
    )
    return [
        {
            "Feature": title,
            OURS: mine,
            THEIRS: Cell(theirs, "theirs"),
            "Where": Cell("table 1" if row < _PRINTED_FEATURES else "text", "theirs"),
        }
        for row, (title, mine, theirs) in enumerate(features)
    ]


def _table_2(actions: pd.DataFrame) -> list[dict[str, str]]:
    """Our labels first, the largest on top, then the paper's that we lack."""
    mine = actions.set_index(actions["action"].str.capitalize())
    labels = [*mine.index, *(label for label in _TABLE_2 if label not in mine.index)]
    labels.sort(key=lambda label: label == NO_ACTION)  # what is left over comes last
    texts = mine.assign(percent=mine["percent"].map("{:.2f} %".format)).astype(object)
    texts = texts.reindex(labels, fill_value="-")
    return [
        {
            "Action": label,
            "Sequences": number(row["sequences"]),
            "Frames": number(row["frames"]),
            OURS: number(row["percent"]),
            THEIRS: number(f"{_TABLE_2[label]:.2f} %" if label in _TABLE_2 else "-", "theirs"),
        }
        for label, row in texts.iterrows()
    ]


def _by_split(overview: pd.DataFrame) -> list[dict[str, str]]:
    return [
        {key.capitalize(): text if key == "measure" else number(text) for key, text in row.items()}
        for row in overview.to_dict("records")
    ]
