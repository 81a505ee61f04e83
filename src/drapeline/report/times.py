"""Time and memory of each step, from Snakemake's benchmark files."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.report.colours import BLUE, GREEN, ORANGE
from drapeline.report.html import Cell, html_table, number, write_page
from drapeline.report.style import label_bar, saved_figure, show_message
from drapeline.schema import Column, Schema, Table, make_table, read_table, write_table

BENCHMARK = Schema(
    "a benchmark",
    {
        "s": Column(float, optional=True),
        "max_rss": Column(float, optional=True),
        "cpu_time": Column(float, optional=True),
        "mean_load": Column(float, optional=True),
    },
    more=True,
)
JOBS = Schema(
    "times of jobs",
    {
        "stage": Column(),
        "rule": Column(),
        "s": Column(float),
        "cpu_s": Column(float),
        "ended_s": Column(float),
        "memory_mb": Column(float, optional=True),
    },
)
ALL = "all"
TIMES = Schema(
    "times of stages and rules",
    {
        "stage": Column(),
        "rule": Column(),
        "jobs": Column(int, low=1),
        **{
            name: Column(float, text=".10g") for name in ("total_s", "mean_s", "longest_s", "cpu_s")
        },
        "peak_memory_mb": Column(float, optional=True, text=".0f"),
    },
    key=("stage", "rule"),
)


def job_times(folders: Iterable[str | Path], stages: Mapping[str, str]) -> Table:
    """A row for each job of `{folder}/{rule}.tsv` and `{folder}/{rule}/*.tsv`.

    Snakemake looks at a job for the last time up to half a minute before its end; by its mean load
    until then, the processor time is carried on. What was not measured counts as 0. Missing folders
    count as empty.

    Args:
        folders: of Snakemake's benchmark files.
        stages: what the names of the files begin with, `{rule}/` or more -> stage of the job. The
            longest beginning counts, and jobs without one are a stage called like their rule.

    Returns:
        Wall-clock and processor time in seconds, when the file was written in seconds since 1970,
        and the largest resident memory in megabytes.

    Raises:
        InputError: a file lacks a column, or a value is not a number.
    """
    jobs = []
    for folder in map(Path, folders):
        for path in sorted(folder.rglob("*.tsv")):
            rule, *job = path.relative_to(folder).with_suffix("").parts
            name = "/".join([rule, *job, *([] if job else [""])])
            stage = stages.get(max(filter(name.startswith, stages), key=len, default=""), rule)
            jobs += [
                {
                    "stage": stage,
                    "rule": rule,
                    "s": row.s,
                    "cpu_s": np.fmax(row.cpu_time, row.s * row.mean_load / 100),
                    "ended_s": path.stat().st_mtime,
                    "memory_mb": row.max_rss,
                }
                for row in read_table(path, BENCHMARK).itertuples()
            ]
    return make_table(JOBS, jobs).fillna({"s": 0.0, "cpu_s": 0.0})


def rule_times(jobs: Table) -> Table:
    """A row for each rule, one for all rules of each stage, and one for all; see `job_times`.

    Stages and the rules of each are sorted by their time, the longest first; sums come last.
    """
    parts = [(*names, part) for names, part in jobs.groupby(["stage", "rule"])]
    parts += [(stage, ALL, part) for stage, part in jobs.groupby("stage")]
    parts += [(ALL, ALL, jobs)] if len(jobs) else []
    rows = [
        {
            "stage": stage,
            "rule": rule,
            "jobs": len(part),
            "total_s": part["s"].sum(),
            "mean_s": part["s"].mean(),
            "longest_s": part["s"].max(),
            "cpu_s": part["cpu_s"].sum(),
            "peak_memory_mb": part["memory_mb"].max(),
        }
        for stage, rule, part in parts
    ]
    of_stage = jobs.groupby("stage")["s"].sum()
    rows.sort(
        key=lambda row: (
            *(row["rule"] == ALL, row["stage"] == ALL),
            *(-of_stage.get(row["stage"], 0), row["stage"], -row["total_s"], row["rule"]),
        )
    )
    return make_table(TIMES, rows).round(2)


def write_times(jobs: Table, *, figure: str | Path, table: str | Path, page: str | Path) -> None:
    """Write the bar chart, the `.tsv` and the HTML tables of the times of stages and rules."""
    times = rule_times(jobs)
    write_table(table, times, TIMES)
    of_stages = times["rule"] == ALL
    write_page(
        page,
        "Time and memory of each step",
        "<p>Wall-clock time of the jobs, added up as if they had run one after the other; they run"
        " in parallel, so the whole run took less. Processor time counts all cores of a job. Steps"
        " kept from an earlier run are listed with the time they took then.</p>",
        html_table(_shown(times[of_stages], ["stage"])),
        "<h2>Rules</h2>",
        html_table(_shown(times[~of_stages], ["stage", "rule"])),
    )
    _plot(figure, jobs)


def _shown(times: Table, names: Sequence[str]) -> list[dict[str, str | Cell]]:
    """Rows of a page, which columns name."""
    headings = {
        "total_s": "All jobs",
        "mean_s": "One job, mean",
        "longest_s": "Longest job",
        "cpu_s": "Processor time",
    }
    return [
        {
            **{name.capitalize(): row[name] for name in names},
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


def duration(seconds: float) -> str:
    """3.2 s, 4 min 05 s or 2 h 03 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _plot(path: str | Path, jobs: Table) -> None:
    times = rule_times(jobs.assign(stage=""))
    times = times[times["rule"] != ALL]
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
        job.xaxis.set_minor_formatter("")
        job.set_xlabel("Each job (s)")
        memory.barh(places, times["peak_memory_mb"].fillna(0), color=GREEN, height=0.68)
        memory.set_xlabel("Peak memory of a job (MB)")
        for each in axes:
            each.set_ylim(len(times) - 0.4, -0.6)
            each.set_yticks(places, times["rule"] if each is total else [])
            each.tick_params(axis="y", length=0)
            each.spines["left"].set_visible(False)
            each.grid(True, axis="x")
