"""One look for all figures: fonts, lines and how they are saved."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drapeline.report.colours import FAINT, INK, QUIET
from drapeline.storage import atomic_file

_SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica", "sans-serif"],
    "font.size": 10.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.labelsize": 10.0,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "figure.facecolor": "white",
    # Text stays text, which can be searched and selected.
    "svg.fonttype": "none",
    "svg.hashsalt": "drapeline",
    "text.parse_math": False,  # names hold dollars
}


@contextmanager
def saved_figure(
    path: str | Path, width_in: float = 7.0, height_in: float = 3.6, columns: int = 1
) -> Iterator[tuple[Figure, Sequence[Axes]]]:
    """Yield a figure and its axes, and write it when the block ends.

    Equal figures give equal files.

    Args:
        path: `.svg` or `.png`.
        width_in: width in inches (100 pixels each in a browser).
        columns: axes side by side.
    """
    with matplotlib.rc_context(_SETTINGS):
        # Figure() and not pyplot: nothing global, no window system.
        figure = Figure(figsize=(width_in, height_in), dpi=100, layout="constrained")
        axes = figure.subplots(1, columns, squeeze=False)[0]
        yield figure, axes
        metadata = {"Date": None} if Path(path).suffix == ".svg" else None
        with atomic_file(path) as scratch:
            figure.savefig(scratch, dpi=160, metadata=metadata)


def show_message(axes: Axes, text: str) -> None:
    """Write a sentence in place of an empty plot."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", color=QUIET, transform=axes.transAxes)


def place_legend_above(axes: Axes) -> None:
    """Put the legend above the plot, clear of the data."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=min(len(handles), 5),
            borderaxespad=0.2,
            columnspacing=1.4,
            handlelength=1.2,
        )


def label_bar(axes: Axes, end: float, place: float, text: str) -> None:
    """Write a value beside the end of a horizontal bar."""
    axes.annotate(
        text, (end, place), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9
    )
