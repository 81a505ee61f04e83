"""Time and memory of each step, from Snakemake's benchmark files."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from drapeline.dataset.tables import read_table, write_table
from drapeline.errors import InputError
from drapeline.report.colours import BLUE, GREEN, ORANGE
from drapeline.report.html import Cell, html_table, write_page
from drapeline.report.style import label_bar, saved_figure, show_message


class StepTime(NamedTuple):
    """Time and memory of all jobs of one rule.

    Attributes:
        rule: its name.
        seconds: wall-clock time of each job, in seconds.
        cpu_s: processor time of all jobs together, in seconds; unmeasured jobs count as 0.
        memory_mb: largest resident memory of a job, in megabytes, or None if unmeasured.
    """

    rule: str
    seconds: tuple[float, ...]
    cpu_s: float
    memory_mb: float | None

    @property
    def total_s(self) -> float:
        """Wall-clock time of all jobs, one after the other."""
        return sum(self.seconds)


def step_times(folders: Iterable[str | Path]) -> list[StepTime]:
    """Read `{folder}/{rule}.tsv` and `{folder}/{rule}/*.tsv`; the longest step comes first.

    Missing folders count as empty.

    Raises:
        InputError: a file lacks a column, or a value is not a number.
    """
    rows: dict[str, list[tuple[float, float | None, float | None]]] = {}
    for folder in map(Path, folders):
        for path in sorted(folder.rglob("*.tsv")):
            rule = path.relative_to(folder).parts[0].removesuffix(".tsv")
            for row in read_table(path, ("s", "max_rss", "cpu_time")):
                values = (_number(path, row, key) for key in ("s", "max_rss", "cpu_time"))
                seconds, memory, cpu = values
                rows.setdefault(rule, []).append((seconds or 0.0, memory, cpu))
    steps = [
        StepTime(
            rule,
            tuple(job[0] for job in jobs),
            sum(job[2] or 0.0 for job in jobs),
            max((job[1] for job in jobs if job[1] is not None), default=None),
        )
        for rule, jobs in rows.items()
    ]
    return sorted(steps, key=lambda step: (-step.total_s, step.rule))


def _number(path: Path, row: Mapping[str, str], key: str) -> float | None:
    if row[key] in {"", "-", "NA", "nan"}:  # the job ended before it could be measured
        return None
    try:
        return float(row[key])
    except ValueError as error:
        raise InputError(f"{path}: {key} is '{row[key]}', expected a number") from error


def time_rows(steps: Sequence[StepTime]) -> list[dict[str, object]]:
    """A row for each step, and one for all."""
    rows: list[dict[str, object]] = [
        {
            "rule": step.rule,
            "jobs": len(step.seconds),
            "total_s": round(step.total_s, 2),
            "mean_s": round(step.total_s / len(step.seconds), 2),
            "longest_s": round(max(step.seconds), 2),
            "cpu_s": round(step.cpu_s, 2),
            "peak_memory_mb": "" if step.memory_mb is None else round(step.memory_mb),
        }
        for step in steps
    ]
    jobs = [second for step in steps for second in step.seconds]
    if jobs:
        rows.append(
            {
                "rule": "all",
                "jobs": len(jobs),
                "total_s": round(sum(jobs), 2),
                "mean_s": round(sum(jobs) / len(jobs), 2),
                "longest_s": round(max(jobs), 2),
                "cpu_s": round(sum(step.cpu_s for step in steps), 2),
                "peak_memory_mb": round(max(step.memory_mb or 0.0 for step in steps)),
            }
        )
    return rows


def write_times(
    steps: Sequence[StepTime], *, figure: str | Path, table: str | Path, page: str | Path
) -> None:
    """Write the bar chart, the `.tsv` and the HTML table of the steps' times."""
    rows = time_rows(steps)
    write_table(table, rows)
    shown = [
        {
            "Rule": row["rule"],
            "Jobs": Cell(row["jobs"], "number"),
            "All jobs": Cell(duration(row["total_s"]), "number", order=row["total_s"]),
            "One job, mean": Cell(duration(row["mean_s"]), "number", order=row["mean_s"]),
            "Longest job": Cell(duration(row["longest_s"]), "number", order=row["longest_s"]),
            "Processor time": Cell(duration(row["cpu_s"]), "number", order=row["cpu_s"]),
            "Peak memory (MB)": Cell(row["peak_memory_mb"], "number"),
        }
        for row in rows
    ]
    write_page(
        page,
        "Time and memory of each step",
        "<p>Wall-clock time of the jobs, added up as if they had run one after the other; they run"
        " in parallel, so the whole run took less. Processor time counts all cores of a job. Steps"
        " kept from an earlier run are listed with the time they took then.</p>",
        html_table(shown),
    )
    _plot(figure, steps)


def duration(seconds: float) -> str:
    """3.2 s, 4 min 05 s or 2 h 03 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _plot(path: str | Path, steps: Sequence[StepTime]) -> None:
    height = 1.2 + 0.32 * max(len(steps), 2)
    with saved_figure(path, width_in=10.0, height_in=height, columns=3) as (_, axes):
        if not steps:
            for each in axes:
                show_message(each, "No benchmark yet")
            return
        places = range(len(steps))
        total, job, memory = axes
        totals = [step.total_s for step in steps]
        total.barh(places, totals, color=BLUE, height=0.68)
        for place, value in zip(places, totals, strict=True):
            label_bar(total, value, place, duration(value))
        total.set_xlim(0, 1.45 * max(totals))
        total.set_xlabel("All jobs (s)")
        for place, step in zip(places, steps, strict=True):
            job.plot(
                [max(second, 0.01) for second in step.seconds],
                [place] * len(step.seconds),
                "o",
                ms=6,
                color=ORANGE,
                alpha=0.6,
                markeredgewidth=0,
            )
        job.set_xscale("log")
        job.xaxis.set_major_formatter("{x:g}")
        job.set_xlabel("Each job (s)")
        peaks = [step.memory_mb or 0.0 for step in steps]
        memory.barh(places, peaks, color=GREEN, height=0.68)
        memory.set_xlabel("Peak memory of a job (MB)")
        for each in axes:
            each.set_ylim(len(steps) - 0.4, -0.6)
            each.set_yticks(places, [step.rule for step in steps] if each is total else [])
            each.tick_params(axis="y", length=0)
            each.spines["left"].set_visible(False)
            each.grid(True, axis="x")
