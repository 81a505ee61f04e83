"""Time and memory of each step, from Snakemake's benchmark files."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from drapeline.report.colours import BLUE, GREEN, ORANGE
from drapeline.report.html import html_table, number, write_page
from drapeline.report.style import label_bar, saved_figure, show_message
from drapeline.schema import Column, Schema, Table, make_table, read_table, write_table

BENCHMARK = Schema(
    "a benchmark",
    {
        "s": Column(float, optional=True),
        "max_rss": Column(float, optional=True),
        "cpu_time": Column(float, optional=True),
    },
    more=True,
)
JOBS = Schema(
    "times of jobs",
    {
        "rule": Column(),
        "s": Column(float),
        "cpu_s": Column(float),
        "memory_mb": Column(float, optional=True),
    },
)
TIMES = Schema(
    "times of rules",
    {
        "rule": Column(),
        "jobs": Column(int, low=1),
        **{
            name: Column(float, text=".10g") for name in ("total_s", "mean_s", "longest_s", "cpu_s")
        },
        "peak_memory_mb": Column(float, optional=True, text=".0f"),
    },
    key=("rule",),
)


def job_times(folders: Iterable[str | Path]) -> Table:
    """A row for each job of `{folder}/{rule}.tsv` and `{folder}/{rule}/*.tsv`.

    Processor time that was not measured counts as 0. Missing folders count as empty.

    Args:
        folders: of Snakemake's benchmark files.

    Returns:
        Wall-clock and processor time in seconds and the largest resident memory in megabytes.

    Raises:
        InputError: a file lacks a column, or a value is not a number.
    """
    jobs = [
        {"rule": rule, "s": row.s, "cpu_s": row.cpu_time, "memory_mb": row.max_rss}
        for folder in map(Path, folders)
        for path in sorted(folder.rglob("*.tsv"))
        for rule in [path.relative_to(folder).parts[0].removesuffix(".tsv")]
        for row in read_table(path, BENCHMARK).itertuples()
    ]
    return make_table(JOBS, jobs).fillna({"s": 0.0, "cpu_s": 0.0})


def rule_times(jobs: Table) -> Table:
    """A row for each rule, the longest first, and one for all; see `job_times`."""
    parts = [*jobs.groupby("rule"), *([("all", jobs)] if len(jobs) else [])]
    rows = [
        {
            "rule": rule,
            "jobs": len(part),
            "total_s": part["s"].sum(),
            "mean_s": part["s"].mean(),
            "longest_s": part["s"].max(),
            "cpu_s": part["cpu_s"].sum(),
            "peak_memory_mb": part["memory_mb"].max(),
        }
        for rule, part in parts
    ]
    rows.sort(key=lambda row: (row["rule"] == "all", -row["total_s"], row["rule"]))
    return make_table(TIMES, rows).round(2)


def write_times(jobs: Table, *, figure: str | Path, table: str | Path, page: str | Path) -> None:
    """Write the bar chart, the `.tsv` and the HTML table of all rules' times."""
    times = rule_times(jobs)
    write_table(table, times, TIMES)
    headings = {
        "total_s": "All jobs",
        "mean_s": "One job, mean",
        "longest_s": "Longest job",
        "cpu_s": "Processor time",
    }
    shown = [
        {
            "Rule": row["rule"],
            "Jobs": number(row["jobs"]),
            **{
                heading: number(duration(row[name]), order=row[name])
                for name, heading in headings.items()
            },
            "Peak memory (MB)": number(
                "" if np.isnan(row["peak_memory_mb"]) else f"{row['peak_memory_mb']:.0f}"
            ),
        }
        for row in times.to_dict("records")
    ]
    write_page(
        page,
        "Time and memory of each step",
        "<p>Wall-clock time of the jobs, added up as if they had run one after the other; they run"
        " in parallel, so the whole run took less. Processor time counts all cores of a job. Steps"
        " kept from an earlier run are listed with the time they took then.</p>",
        html_table(shown),
    )
    _plot(figure, jobs, times[times["rule"] != "all"])


def duration(seconds: float) -> str:
    """3.2 s, 4 min 05 s or 2 h 03 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _plot(path: str | Path, jobs: Table, times: Table) -> None:
    height = 1.2 + 0.32 * max(len(times), 2)
    with saved_figure(path, width_in=10.0, height_in=height, columns=3) as (_, axes):
        if not len(times):
            for each in axes:
                show_message(each, "No benchmark yet")
            return
        places = range(len(times))
        total, job, memory = axes
        total.barh(places, times["total_s"], color=BLUE, height=0.68)
        for place, value in zip(places, times["total_s"], strict=True):
            label_bar(total, value, place, duration(value))
        total.set_xlim(0, 1.45 * times["total_s"].max())
        total.set_xlabel("All jobs (s)")
        for place, rule in zip(places, times["rule"], strict=True):
            seconds = jobs.loc[jobs["rule"] == rule, "s"].clip(lower=0.01)
            job.plot(
                seconds,
                [place] * len(seconds),
                "o",
                ms=6,
                color=ORANGE,
                alpha=0.6,
                markeredgewidth=0,
            )
        job.set_xscale("log")
        job.xaxis.set_major_formatter("{x:g}")
        job.set_xlabel("Each job (s)")
        memory.barh(places, times["peak_memory_mb"].fillna(0), color=GREEN, height=0.68)
        memory.set_xlabel("Peak memory of a job (MB)")
        for each in axes:
            each.set_ylim(len(times) - 0.4, -0.6)
            each.set_yticks(places, times["rule"] if each is total else [])
            each.tick_params(axis="y", length=0)
            each.spines["left"].set_visible(False)
            each.grid(True, axis="x")
