"""Curves and bars of Garment4D: figure 6 without single parts, the sweeps of figures 8 to 10."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

from drapeline.metrics.sequence import MODEL
from drapeline.metrics.table import HIGH, LOW, MetricRow, find_value
from drapeline.report.colours import BLUE, GARMENT_COLOURS, GREEN, INK, QUIET, SKY
from drapeline.report.models.garment_columns import garment_columns
from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message

_BASELINE = "#b4b8be"


def _test_rows(rows: Iterable[MetricRow]) -> list[MetricRow]:
    return [row for row in rows if row.model == MODEL and row.split == "test"]


class Curve(NamedTuple):
    """Values (n,) of a metric over a quantity (n,), with the ends of their intervals or NaN."""

    at: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def curve(
    rows: Sequence[MetricRow],
    prefix: str,
    garment: str,
    metric: str,
    ends: Mapping[float, str] | None = None,
) -> Curve:
    """A metric of the variants `{prefix}_{number}` on the test split, by rising number.

    Args:
        rows: the table of metrics.
        prefix: such as "neighbours".
        garment: type.
        metric: name.
        ends: number -> variant that stands for it where none of the prefix does.
    """
    rows = _test_rows(rows)
    numbered = {
        float(row.variant.removeprefix(prefix + "_")): row.variant
        for row in rows
        if row.variant.startswith(prefix + "_")
    }
    found = []
    if numbered:
        for at, variant in sorted({**(ends or {}), **numbered}.items()):
            value, low, high = (
                find_value(rows, variant, "test", garment, metric + end) for end in ("", LOW, HIGH)
            )
            if value:
                bounds = [end.value if end else np.nan for end in (low, high)]
                found.append((at, value.value, *bounds))
    return Curve(*np.array(found, dtype=np.float64).reshape(-1, 4).T)


def _draw_curve(axes: Axes, found: Curve, colour: str, label: str) -> None:
    if np.isfinite(found.low).all():
        axes.fill_between(found.at, found.low, found.high, color=colour, alpha=0.14, linewidth=0)
    axes.plot(found.at, found.value, color=colour, marker="o", markersize=4.5, label=label)


def plot_neighbour_curve(path: str | Path, rows: Sequence[MetricRow]) -> None:
    """Figure 8: error and time over the number K of body vertices that weights come from."""
    panels = (
        ("vertex_error_mm", "Vertex error M2 (mm)", 1.0),
        ("inference_s_per_frame", "Time per frame (ms)", 1000.0),
    )
    with saved_figure(path, 9.0, 3.4, columns=2) as (_, axes):
        for panel, (metric, label, scale) in zip(axes, panels, strict=True):
            drawn = []
            for garment in garment_columns(rows):
                found = curve(rows, "neighbours", garment, metric)
                if len(found.at):
                    scaled = Curve(found.at, *(scale * np.array(found[1:])))
                    _draw_curve(panel, scaled, GARMENT_COLOURS[garment], garment)
                    drawn += found.at.tolist()
            if not drawn:
                show_message(panel, "Not measured.")
                continue
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_locator(FixedLocator(sorted(set(drawn))))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
            panel.set(xlabel="Neighbours K", ylabel=label, ylim=(0, None))
            panel.grid(axis="y")
            place_legend_above(panel)


def plot_missing_curve(path: str | Path, rows: Sequence[MetricRow]) -> None:
    """Figure 9: error over the share of the cloud that holes take away."""
    _plot_robustness(path, rows, "missing", {0.0: "posed"}, "Points missing (%)")


def plot_accuracy_curve(path: str | Path, rows: Sequence[MetricRow]) -> None:
    """Figure 10: error over the share of points with the right label."""
    _plot_robustness(path, rows, "accuracy", None, "Segmentation accuracy (%)")


def _plot_robustness(
    path: str | Path,
    rows: Sequence[MetricRow],
    prefix: str,
    ends: Mapping[float, str] | None,
    label: str,
) -> None:
    """Curves of the posed garments, with what skinning alone reaches dashed."""
    with saved_figure(path, 5.6, 3.6) as (_, (axes,)):
        drawn = False
        for garment in garment_columns(rows):
            found = curve(rows, prefix, garment, "vertex_error_mm", ends)
            if not len(found.at):
                continue
            drawn, colour = True, GARMENT_COLOURS[garment]
            _draw_curve(axes, found, colour, garment)
            skinned = find_value(rows, "lbs", "test", garment, "vertex_error_mm")
            if skinned:
                axes.axhline(skinned.value, color=colour, linewidth=1, linestyle=(0, (4, 3)))
        if not drawn:
            show_message(axes, "Not measured.")
            return
        axes.plot([], [], color=QUIET, linewidth=1, linestyle=(0, (4, 3)), label="Interpolated LBS")
        axes.set(xlabel=label, ylabel="Vertex error M2 (mm)", ylim=(0, None))
        axes.grid(axis="y")
        place_legend_above(axes)


_ABLATIONS = {
    "lbs": "Interpolated LBS",
    "mgn": "MGN*",
    "no_body_encoder": "without body encoder",
    "no_transformer": "without temporal transformer",
    "as_printed": "displacements as in the paper",
    "nearest_weights": "with K = 1",
    "posed": "Full model",
    "ours": "Our variant",
}


def plot_ablation(path: str | Path, rows: Sequence[MetricRow], garment: str) -> None:
    """Figure 6: vertex and acceleration errors without single parts of the model.

    Args:
        path: the figure.
        rows: the table of metrics.
        garment: type shown.
    """
    rows = _test_rows(rows)
    panels = (
        ("vertex_error_mm", "Vertex error M2 (mm)", 1),
        ("acceleration_error_m_s2", "Acceleration error M3 (m/s²)", 2),
    )
    there = [
        name
        for name in _ABLATIONS
        if find_value(rows, name, "test", garment, "vertex_error_mm") is not None
    ]
    with saved_figure(path, 9.0, 0.9 + 0.36 * max(len(there), 3), columns=2) as (_, axes):
        for number, (panel, (metric, title, digits)) in enumerate(zip(axes, panels, strict=True)):
            if not there:
                show_message(panel, "Not measured.")
                continue
            for place, name in enumerate(there):
                _draw_bar(panel, rows, name, garment, metric, place, digits)
            panel.set_yticks(
                range(len(there)), [_ABLATIONS[n] for n in there] if not number else []
            )
            panel.invert_yaxis()
            panel.set(xlabel=title, title=f"{garment}" if not number else "")
            panel.tick_params(axis="y", length=0)
            panel.margins(x=0.18)
            panel.set_xlim(left=0)
            panel.grid(axis="x")


def _draw_bar(
    axes: Axes,
    rows: Sequence[MetricRow],
    variant: str,
    garment: str,
    metric: str,
    place: int,
    digits: int,
) -> None:
    value, low, high = (
        find_value(rows, variant, "test", garment, metric + end) for end in ("", LOW, HIGH)
    )
    if value is None:
        return
    colour = {"posed": BLUE, "ours": GREEN, "lbs": _BASELINE, "mgn": _BASELINE}
    axes.barh(place, value.value, height=0.62, color=colour.get(variant, SKY))
    end = value.value
    if low and high:
        axes.plot([low.value, high.value], [place, place], color=INK, linewidth=1.2)
        end = high.value
    label_bar(axes, end, place, f"{value.value:.{digits}f}")
