"""Curves and bars of Garment4D: figure 6 without single parts, the sweeps of figures 8 to 10."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

from drapeline.metrics.garment4d import MODEL
from drapeline.metrics.registry import metric, variant
from drapeline.outfits.garment_types import TEMPLATE_TYPES
from drapeline.report.colours import BLUE, GARMENT_COLOURS, GREEN, INK, QUIET, SKY
from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message
from drapeline.schema import Table

_BASELINE = "#b4b8be"
_DASHED = {"linewidth": 1, "linestyle": (0, (4, 3))}
_ABLATIONS = (
    *("lbs", "mgn", "no_body_encoder", "no_transformer", "as_printed", "nearest_weights"),
    *("posed", "ours"),
)


def curve(
    measured: Table,
    prefix: str,
    garment: str,
    name: str,
    ends: Mapping[float, str] | None = None,
) -> pd.DataFrame:
    """A metric of the variants `{prefix}_{number}`, by rising number.

    Args:
        measured: rows of the test split, see `read_test_metrics`.
        prefix: such as "neighbours".
        garment: type.
        name: of the metric.
        ends: number -> variant that stands for it where none of the prefix does.

    Returns:
        Columns "at", and "value", "low" and "high" as they are shown; no rows if the prefix has
        none.
    """
    rows = _of(measured, garment, name)
    start = f"{prefix}_"
    numbered = rows[rows["variant"].str.startswith(start)]
    found = numbered.assign(at=numbered["variant"].str.removeprefix(start).astype(float))
    if len(found):
        known = set(found["at"])
        beside = {other: at for at, other in (ends or {}).items() if at not in known}
        others = rows[rows["variant"].isin([*beside])]
        found = pd.concat([found, others.assign(at=others["variant"].map(beside))])
    numbers = found[["value", "low", "high"]] * metric(name).scale
    return numbers.assign(at=found["at"]).sort_values("at")


def _of(measured: Table, garment: str, name: str) -> Table:
    """Rows of a metric and type, on the samples of all solvers."""
    wanted = {"garment": garment, "metric": name, "source": ""}
    return measured[(measured[[*wanted]] == pd.Series(wanted)).all(axis=1)]


def _value(measured: Table, name: str, garment: str, key: str) -> pd.Series | None:
    found = _of(measured, garment, key)
    found = found[found["variant"] == name]
    return found.iloc[0] if len(found) else None


def _draw_curve(axes: Axes, found: pd.DataFrame, colour: str, label: str) -> None:
    at = found["at"].to_numpy()
    if found["low"].notna().all():
        axes.fill_between(at, found["low"], found["high"], color=colour, alpha=0.14, linewidth=0)
    axes.plot(at, found["value"], color=colour, marker="o", markersize=4.5, label=label)


def plot_neighbour_curve(path: str | Path, measured: Table) -> None:
    """Figure 8: error and time over the number K of body vertices that weights come from."""
    with saved_figure(path, 9.0, 3.4, columns=2) as (_, axes):
        for panel, name in zip(axes, ("vertex_error_mm", "inference_s_per_frame"), strict=True):
            drawn = []
            for garment in TEMPLATE_TYPES:
                found = curve(measured, "neighbours", garment, name)
                if len(found):
                    _draw_curve(panel, found, GARMENT_COLOURS[garment], garment)
                    drawn += found["at"].tolist()
            if not drawn:
                show_message(panel, "Not measured.")
                continue
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_locator(FixedLocator(sorted(set(drawn))))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
            panel.set(xlabel="Neighbours K", ylabel=metric(name).heading, ylim=(0, None))
            panel.grid(axis="y")
            place_legend_above(panel)


def plot_missing_curve(path: str | Path, measured: Table) -> None:
    """Figure 9: error over the share of the cloud that holes take away."""
    _plot_robustness(path, measured, "missing", {0.0: "posed"}, "Points missing (%)")


def plot_accuracy_curve(path: str | Path, measured: Table) -> None:
    """Figure 10: error over the share of points with the right label."""
    _plot_robustness(path, measured, "accuracy", None, "Segmentation accuracy (%)")


def _plot_robustness(
    path: str | Path,
    measured: Table,
    prefix: str,
    ends: Mapping[float, str] | None,
    label: str,
) -> None:
    """Curves of the posed garments, with what skinning alone reaches dashed."""
    name = "vertex_error_mm"
    with saved_figure(path, 5.6, 3.6) as (_, (axes,)):
        drawn = False
        for garment in TEMPLATE_TYPES:
            found = curve(measured, prefix, garment, name, ends)
            if not len(found):
                continue
            drawn, colour = True, GARMENT_COLOURS[garment]
            _draw_curve(axes, found, colour, garment)
            skinned = _value(measured, "lbs", garment, name)
            if skinned is not None:
                axes.axhline(skinned["value"], color=colour, **_DASHED)
        if not drawn:
            show_message(axes, "Not measured.")
            return
        axes.plot([], [], color=QUIET, label=variant(MODEL, "lbs").title, **_DASHED)
        axes.set(xlabel=label, ylabel=metric(name).heading, ylim=(0, None))
        axes.grid(axis="y")
        place_legend_above(axes)


def plot_ablation(path: str | Path, measured: Table, garment: str) -> None:
    """Figure 6: vertex and acceleration errors without single parts of the model.

    Args:
        path: the figure.
        measured: rows of the test split, see `read_test_metrics`.
        garment: type shown.
    """
    names = [n for n in _ABLATIONS if _value(measured, n, garment, "vertex_error_mm") is not None]
    with saved_figure(path, 9.0, 0.9 + 0.36 * max(len(names), 3), columns=2) as (_, axes):
        for panel, key in zip(axes, ("vertex_error_mm", "acceleration_error_m_s2"), strict=True):
            if not names:
                show_message(panel, "Not measured.")
                continue
            for place, name in enumerate(names):
                row = _value(measured, name, garment, key)
                if row is not None:
                    _draw_bar(panel, row, place, metric(key).digits)
            first = panel is axes[0]
            titles = [variant(MODEL, name).title for name in names]
            panel.set_yticks(range(len(names)), titles if first else [])
            panel.invert_yaxis()
            panel.set(xlabel=metric(key).heading, title=garment if first else "")
            panel.tick_params(axis="y", length=0)
            panel.margins(x=0.18)
            panel.set_xlim(left=0)
            panel.grid(axis="x")


def _draw_bar(axes: Axes, row: pd.Series, place: int, digits: int) -> None:
    colour = {"posed": BLUE, "ours": GREEN, "lbs": _BASELINE, "mgn": _BASELINE}
    axes.barh(place, row["value"], height=0.62, color=colour.get(row["variant"], SKY))
    measured = not np.isnan(row["high"])
    if measured:
        axes.plot([row["low"], row["high"]], [place, place], color=INK, linewidth=1.2)
    end = row["high"] if measured else row["value"]
    label_bar(axes, end, place, f"{row['value']:.{digits}f}")
