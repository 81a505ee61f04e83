"""Figures and a table of the simulated samples' health."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drapeline.dataset.record import SampleRecord, meta_path
from drapeline.dataset.tables import STATUS
from drapeline.errors import InputError
from drapeline.report.colours import BLUE, FAINT, GREEN, SKY
from drapeline.report.html import Cell, number
from drapeline.report.style import place_legend_above, saved_figure, show_message
from drapeline.report.tables import Section, write_sections
from drapeline.schema import Table, read_table

ACCEPTED_SHARE_MIN = 0.9
_NAMED_SAMPLES = 48  # more rows would be illegible, so samples are ranked instead
_ROW_IN = 0.24


@dataclass(frozen=True)
class HealthMeasure:
    """A quantity of a sample, and its place in `meta.json`."""

    title: str
    short: str  # one word, for a column's heading
    unit: str
    # (measure, statistic) of the low end, the middle and the high end in the `health` of a sample's
    # `meta.json`; None where there is none.
    keys: tuple[tuple[str, str] | None, tuple[str, str] | None, tuple[str, str] | None]
    factor: float = 1.0  # from the stored to the shown number
    digits: int = 2  # decimals shown
    # Goal for the shown number, from and to; None where there is no such bound.
    bounds: tuple[float | None, float | None] = (None, None)
    # Which of low end (0), middle (1) and high end (2) tables show and goals apply to.
    judged: tuple[int, ...] = (1,)
    about: str = "dot: mean over the frames, line: smallest to largest"  # meaning of dot and line

    @property
    def label(self) -> str:
        """Title with unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def values(self, record: SampleRecord) -> tuple[float, float, float]:
        """Low end, middle and high end; NaN where unmeasured."""
        health = record.meta.get("health", {})
        low, middle, high = (
            float("nan")
            if key is None
            else self.factor * health.get(key[0], {}).get(key[1], np.nan)
            for key in self.keys
        )
        return low, middle, high

    def holds(self, *values: float) -> bool:
        """Whether measured values are within the bounds."""
        lower, upper = self.bounds
        measured = [value for value in values if np.isfinite(value)]
        return all(
            (lower is None or value >= lower) and (upper is None or value <= upper)
            for value in measured
        )


def _over_frames(key: str) -> tuple[tuple[str, str], tuple[str, str], tuple[str, str]]:
    return (key, "min"), (key, "mean"), (key, "max")


MEASURES = {
    "penetration": HealthMeasure(
        "Garment vertices inside the body", "Inside", "%",
        _over_frames("inside_share"), 100.0,
        bounds=(None, 0.5),
    ),
    "outside_folds": HealthMeasure(
        "Garment vertices inside the body, outside its folds", "Outside folds", "%",
        _over_frames("inside_open_share"), 100.0,
        bounds=(None, 0.2),
    ),
    "depth": HealthMeasure(
        "Deepest vertex inside the body", "Depth", "mm",
        _over_frames("depth_max_m"), 1000.0, digits=1
    ),
    "stretch": HealthMeasure(
        "Edge length to rest length", "Stretch", "",
        (("stretch_p01", "mean"), ("stretch_p50", "mean"), ("stretch_p99", "mean")),
        bounds=(0.85, 1.20), judged=(0, 2),
        about="dot: median of the edges, line: 1st to 99th percentile, mean over the frames",
    ),
    "gap": HealthMeasure(
        "Gap between cloth and body", "Gap", "mm",
        (("gap_p05_m", "mean"), ("gap_p50_m", "mean"), None), 1000.0, digits=1, judged=(0, 1),
        about="dot: median of the vertices, line: from the 5th percentile, mean over the frames",
    ),
    "acceleration": HealthMeasure(
        "Mean acceleration", "Acceleration", "m/s²",
        _over_frames("acceleration_m_s2"),
    ),
    "self_crossing": HealthMeasure(
        "Edges through the garment's own faces", "Self-crossing", "%",
        _over_frames("self_share"), 100.0
    ),
    "layers": HealthMeasure(
        "Outer vertices beneath the inner garment", "Beneath", "%",
        _over_frames("layer_share"), 100.0
    ),
    "slip": HealthMeasure(
        "Slip along the body", "Slip", "mm",
        _over_frames("slip_m"), 1000.0, digits=1,
    ),
}  # fmt: skip


def plot_measure(path: str | Path, records: Sequence[SampleRecord], measure: HealthMeasure) -> None:
    """Draw a line and dot for each sample, and the band that the goal allows."""
    values = np.array([measure.values(record) for record in records]).reshape(-1, 3)
    names = [record.meta["id"] for record in records]
    _plot_rows(path, names, values, measure)


def plot_speed(path: str | Path, records: Sequence[SampleRecord]) -> None:
    """Draw the simulated frames per second of each sample, on one core.

    Raises:
        InputError: a sample has no speed of simulation.
    """
    speeds = []
    for record in records:
        speed = record.meta["simulation"].get("frames_per_second")
        if speed is None:
            raise InputError(
                f"{meta_path(record.folder)}: lacks simulation.frames_per_second, expected a number"
            )
        speeds.append((np.nan, float(speed), np.nan))
    measure = HealthMeasure(
        "Simulation speed",
        "Speed",
        "frames/s on one core",
        (None, None, None),
        about="retries not counted",
    )
    names = [record.meta["id"] for record in records]
    _plot_rows(path, names, np.array(speeds).reshape(-1, 3), measure, from_zero=True)


def _plot_rows(
    path: str | Path,
    names: Sequence[str],
    values: np.ndarray,
    measure: HealthMeasure,
    from_zero: bool = False,
) -> None:
    """Draw horizontal rows from low to high, with a dot in the middle; values (S, 3)."""
    measured = np.isfinite(values).any(axis=1)
    values, names = values[measured], [n for n, ok in zip(names, measured, strict=True) if ok]
    ranked = len(names) > _NAMED_SAMPLES
    height = 1.5 + _ROW_IN * (20 if ranked else max(len(names), 4))
    with saved_figure(path, height_in=height) as (_, (axes,)):
        if not names:
            show_message(axes, f"{measure.title}: not measured in any accepted sample")
            return
        if ranked:
            values = values[np.argsort(np.nan_to_num(values[:, 1], nan=values[:, 2].max()))]
        low, middle, high = values.T
        places = np.arange(len(values))
        _draw_band(axes, measure)
        far = np.where(np.isfinite(high), high, middle)
        axes.hlines(places, low, far, color=SKY, lw=1 if ranked else 3, label="_")
        axes.plot(middle, places, "o", color=BLUE, ms=3 if ranked else 6, markeredgewidth=0)
        axes.set_yticks([] if ranked else places, [] if ranked else names, fontsize=9)
        axes.set_ylabel("Samples, by value" if ranked else "Sample")
        axes.set_ylim(len(values) - 0.4, -0.6)
        if from_zero or (measure.bounds[0] is None and np.nanmin(values) >= 0):
            axes.set_xlim(left=0)
        axes.set_xlabel(f"{measure.label}\n{measure.about}")
        axes.grid(True, axis="x")
        axes.tick_params(axis="y", length=0)
        place_legend_above(axes)


def _draw_band(axes: Axes, measure: HealthMeasure) -> None:
    lower, upper = measure.bounds
    if upper is None:
        return
    text = f"goal: {'' if lower is None else f'{lower:g} to '}{'at most ' if lower is None else ''}"
    axes.axvspan(
        lower if lower is not None else 0.0, upper, color=FAINT, lw=0, zorder=0,
        label=f"{text}{upper:g} {measure.unit}".strip(),
    )  # fmt: skip
    for bound in (lower, upper):
        if bound is not None:
            axes.axvline(bound, color=GREEN, lw=1.2)


def write_health_page(
    path: str | Path, dataset: str | Path, records: Sequence[SampleRecord]
) -> None:
    """Write the page with the goals, the values reached, and every sample.

    Args:
        dataset: folder of the collected dataset.

    Raises:
        InputError: `status.tsv` is missing or lacks a column.
    """
    status = read_table(Path(dataset) / "status.tsv", STATUS)
    about = (
        "Goals and values reached: means over frames, garments and accepted samples; for stretch,"
        " the 1st and 99th percentile of the edges, and for the gap, the 5th and 50th of the"
        " vertices. Then every sample, with the reason if it was rejected. Values that miss the"
        " goal are red."
    )
    accepted = {record.meta["id"]: record for record in records}
    sections = [
        Section("Goals", _goal_rows(status, records)),
        Section("Samples", _sample_rows(status, accepted)),
    ]
    write_sections(path, "Health of the samples", [about], sections)


def _goal_rows(status: Table, records: Sequence[SampleRecord]) -> list[dict[str, str]]:
    accepted = int((status["status"] == "accepted").sum())
    share = accepted / max(len(status), 1)
    rows = [
        {
            "Measure": "Samples accepted",
            "Goal": number(f"at least {100 * ACCEPTED_SHARE_MIN:.0f} %"),
            "Reached": _verdict(
                f"{accepted} of {len(status)} ({100 * share:.0f} %)", share >= ACCEPTED_SHARE_MIN
            ),
        }
    ]
    for measure in MEASURES.values():
        values = np.array([measure.values(record) for record in records]).reshape(-1, 3)
        values = values[:, measure.judged]
        values = values[np.isfinite(values).all(axis=1)]
        if not len(values):
            continue
        means = values.mean(axis=0)
        rows.append(
            {
                "Measure": measure.label,
                "Goal": number(_goal(measure)),
                "Reached": _verdict(
                    " to ".join(f"{mean:.{measure.digits}f}" for mean in means),
                    measure.holds(*means),
                    measure.bounds != (None, None),
                ),
            }
        )
    speeds = [record.meta["simulation"].get("frames_per_second") for record in records]
    speeds = [speed for speed in speeds if speed is not None]
    if speeds:
        text = f"{np.mean(speeds):.2f} ({min(speeds):.2f} to {max(speeds):.2f})"
        rows.append(
            {
                "Measure": "Simulation speed (frames/s on one core)",
                "Goal": number("-"),
                "Reached": number(text),
            }
        )
    return rows


def _goal(measure: HealthMeasure) -> str:
    lower, upper = measure.bounds
    if lower is None:
        return "-" if upper is None else f"at most {upper:g}"
    return f"{lower:g} to {upper:g}"


def _verdict(text: str, good: bool, judged: bool = True) -> Cell:
    if not judged:
        return number(text)
    return number(f"{'✓' if good else '✗'} {text}", "good" if good else "bad")


def _sample_rows(status: Table, accepted: Mapping[str, SampleRecord]) -> list[dict[str, str]]:
    rows = []
    for row in status.itertuples():
        shown = {
            "Sample": row.sample,
            "Status": Cell(row.status, "good" if row.status == "accepted" else "bad"),
            "Reason": row.reason,
            "Garments": row.garments.replace("+", " + "),
            "Motion": row.sequence,
            "Split": row.split,
            "Tries": number(row.attempts),
        }
        for measure in MEASURES.values():
            heading = measure.short + (f" ({measure.unit})" if measure.unit else "")
            shown[heading] = _sample_cell(measure, accepted.get(row.sample))
        rows.append(shown)
    return rows


def _sample_cell(measure: HealthMeasure, record: SampleRecord | None) -> Cell:
    if record is None:
        return number("")
    values = [measure.values(record)[which] for which in measure.judged]
    if not np.isfinite(values).all():
        return number("-")
    text = " to ".join(f"{value:.{measure.digits}f}" for value in values)
    return number(text) if measure.holds(*values) else number(text, "bad")
