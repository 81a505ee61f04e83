"""Write the tables of the documentation from one finished experiment, and what a run of it takes.

    .venv/bin/python docs/write_tables.py RESULTS [--reference]

Replaces what stands between `<!-- table: NAME -->` and `<!-- end of table -->`, and within lines
between `<!-- figure: NAME -->` and `<!-- end -->`: with `--reference` in the page of the reference
experiment, without in all others, and with them the times of jobs by which a run says how long it
will take. RESULTS is the folder of results within the checkout that made them.
"""

import argparse
import json
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from drapeline.dataset.card import markdown_table
from drapeline.dataset.record import SPLITS, SampleRecord, clip_name, read_record, solver_name
from drapeline.dataset.shards import samples_of
from drapeline.metrics.properties import CLASSES, COMMON
from drapeline.metrics.registry import variants
from drapeline.metrics.shared import TRAINING_ERROR
from drapeline.metrics.table import ALL
from drapeline.outfits.garment_types import GARMENT4D_TYPES, GARMENTS
from drapeline.report.dataset.health import MEASURES
from drapeline.report.registration_table import SUMMARY
from drapeline.report.tables import MetricTable, garment_title, read_test_metrics
from drapeline.report.times import ALL as ALL_RULES
from drapeline.report.times import TIMES, job_times
from drapeline.schema import read_table

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs/reference/reference-experiment.md"
PAGES = [ROOT / "README.md", *sorted({*(ROOT / "docs").rglob("*.md")} - {REFERENCE})]
USUAL = ROOT / "src/snakemake_logger_plugin_drapeline/seconds.json"
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
FIGURE = re.compile(r"(<!-- figure: (\w+) -->).*?(<!-- end -->)")
STATIC = ("static_ppca", "static_ppca_64", "svae", "pca", "mean_garment", "nearest_cvar")
FLOOR = ("again_rest_shape", "again_other_solver")
RECONSTRUCTED = ("dynamic_ppca_settled", "dynamic_ppca", "dvae_unposed_4", "wrinkle_pca", *FLOOR)
PREDICTED = (
    *("wrinkle_mlp", "dynamic_ppca_prior", "dvae_unposed_4_prior", "wrinkle_ridge"),
    *("skinned_mean", "skinned_static", "skinned_mean_garment", *FLOOR),
)
POSED = ("lbs", "untrained", "mgn", "posed", "ours_proposals", "ours")
ORACLES = ("ours_true_labels", "ours_true_rest")
HELD = ("fitted", "nearest_cut", "nearest_style", "mean_code")
SURFACES = ("surface_to_true_mm", "true_to_surface_mm")

ERRORS = ("surface_error_mm", TRAINING_ERROR, "normal_error_deg")
by_type = partial(MetricTable, across="garment", count="")
METRIC_TABLES = {
    "static": MetricTable(STATIC, (*ERRORS, "mask_iou", "active_units"), count=""),
    "static_by_type": by_type(STATIC, ["surface_error_mm"], GARMENTS),
    "reconstructed": MetricTable(
        RECONSTRUCTED, (*ERRORS, "inside_share", "active_units"), count=""
    ),
    "reconstructed_by_type": by_type(RECONSTRUCTED, ["surface_error_mm"], GARMENTS),
    "predicted": MetricTable(PREDICTED, (*ERRORS, "inside_share"), count=""),
    "predicted_by_type": by_type(PREDICTED, ["surface_error_mm"], GARMENTS),
    "canonical": by_type(
        ("canonical", "pointnet", "regression", "ours", "mean_garment", "pca"),
        ["canonical_error_mm"],
        GARMENT4D_TYPES,
    ),
    "labels": by_type(
        ("canonical", "label_by_vertex", "one_label", "ours"),
        ["segmentation_accuracy"],
        GARMENT4D_TYPES,
    ),
    "posed": by_type((*POSED, *ORACLES), ["vertex_error_mm"], GARMENT4D_TYPES),
    "posed_surface": by_type(POSED, ["predicted_to_true_mm"], GARMENT4D_TYPES),
    "posed_surface_back": by_type(POSED, ["true_to_predicted_mm"], GARMENT4D_TYPES),
    "velocity": by_type(("still", *POSED), ["velocity_error_m_s"], GARMENT4D_TYPES),
    "acceleration": by_type(("still", *POSED), ["acceleration_error_m_s2"], GARMENT4D_TYPES),
    "contact": by_type(("truth", *POSED), ["inside_share"], GARMENT4D_TYPES),
    "by_solver": MetricTable(
        (
            *("dynamic_ppca_settled", "dynamic_ppca", "dvae_unposed_4", "wrinkle_ridge"),
            *("wrinkle_mlp", "skinned_mean", "skinned_static", *FLOOR),
            *("regression", "canonical", "untrained", "posed", "ours"),
        ),
        ("surface_error_mm", "canonical_error_mm", "vertex_error_mm"),
        (*GARMENT4D_TYPES, ALL),
        down=("metric", "garment", "variant"),
        across="source",
        best=False,
        count="Number",
    ),
    "smplicit": MetricTable(
        [name for name in variants("smplicit") if name.endswith(HELD) and "images" not in name],
        (*SURFACES, "normal_error_deg", "openings_right"),
        count="",
    ),
    "smplicit_images": MetricTable(
        [name for name in variants("smplicit") if name.startswith("smplicit_images_")],
        ("silhouette_iou", "better_than_mean_share", "segmentation_accuracy", *SURFACES),
        digits=dict.fromkeys(("segmentation_accuracy", *SURFACES), 0),
        count="",
    ),
    "scans": MetricTable(
        [name for name in variants("scan") if not name.startswith("scan_body_")],
        SURFACES,
        best=False,
    ),
    "scans_by_class": by_type(
        [name for name in variants("scan") if not name.startswith("scan_body_")],
        ["surface_to_true_mm"],
        (*CLASSES, COMMON),
        best=False,
    ),
    "pictures": MetricTable(
        (
            *variants("picture"),
            *(f"smplicit_images_{name}" for name in ("hung", "fitted", "nearest", "mean_code")),
        ),
        ("rest_to_true_mm", "true_to_rest_mm"),
        count="Garments",
    ),
    "representations": MetricTable(
        sorted(variants("representation"), key=lambda name: name.endswith("_registered")),
        ("code_numbers", *SURFACES),
        digits=dict.fromkeys(SURFACES, 2),
        count="",
    ),
}


class Results:
    """What the tables are made of.

    Attributes:
        folder: of the experiment.
        metrics: rows of its `metrics.tsv`, of the test split.
        records: its samples in motion by group, rejected ones too.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.metrics = read_test_metrics(folder / "metrics.tsv")
        self.records = {
            group.name: list(map(read_record, samples_of(sorted(group.glob("[!.]*")))))
            for group in sorted((folder / "samples").glob("[!.]*"))
        }

    @cached_property
    def times(self) -> pd.DataFrame:
        """Of its stages and rules."""
        return read_table(self.folder / "report" / "times.tsv", TIMES)

    def accepted(self, *, published: bool) -> list[SampleRecord]:
        """Accepted samples of the groups that are published, or of the others."""
        dataset = {path.name for path in (self.folder / "dataset").glob("*/*")}
        return [
            record
            for records in self.records.values()
            for record in records
            if record.accepted and (record.meta["id"] in dataset) == published
        ]


def _span(numbers: Sequence[int]) -> str:
    """The least and the largest of rising numbers, in words."""
    if not numbers:
        return "no"
    return f"{numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else str(numbers[0])


def origin(results: Results) -> str:
    """Which experiment the tables are of."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=results.folder, capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    metrics = results.metrics[results.metrics["source"] == ""]
    seeds = sorted(metrics["seed"].unique())
    held_out = metrics.loc[metrics["variant"].isin(STATIC), "n"].max()
    ours = metrics[(metrics["model"] == "garment4d") & (metrics["variant"] == "ours")]
    moving = sorted(ours["n"].unique())
    clips = {
        clip_name(record.meta, record.meta["id"])
        for records in results.records.values()
        for record in records
        if record.accepted and record.meta["split"] == "test"
    }
    return (
        f"Commit {commit}, seed {', '.join(map(str, seeds))}, one training of each model."
        f" {_by_solver(results.accepted(published=True))} are published;"
        f" {_by_solver(results.accepted(published=False))} more are there to learn from and to test"
        f" on; the test split has {held_out} garments at"
        f" rest, and {_span(moving)} moving sequences of"
        f" each of Garment4D's types, in {len(clips)} clips. Brackets hold 95 % intervals over"
        " outfits, or over clips where garments move; they do not cover what another seed would"
        " change.\n"
    )


def _by_solver(records: Sequence[SampleRecord]) -> str:
    counts = Counter(solver_name(record.meta) for record in records)
    return " and ".join(f"{count} samples by {solver}" for solver, count in counts.items())


def registration(results: Results) -> str:
    """From the garment to offsets and back, by type."""
    errors = read_table(results.folder / "report" / "registration.tsv", SUMMARY)
    errors = errors[errors["source"] == "static"]
    shown = {
        "Garment to rebuilt (mm)": "garment_to_rebuilt_mean_mm",
        "Rebuilt to garment (mm)": "rebuilt_to_garment_mean_mm",
        "Area lost (%)": "area_lost_percent",
    }
    return markdown(
        {"Garment": garment_title(garment), "Garments": part["garments"].iloc[0]}
        | {
            title: f"{row['mean']:.2f} (worst {row['max']:.2f})"
            for title, metric in shown.items()
            for _, row in part[part["metric"] == metric].iterrows()
        }
        for garment, part in errors.groupby("garment", sort=False)
    )


def learning_group(results: Results) -> str:
    """Samples of the learning group by split, and the garments of those that were accepted."""
    table, learning = [], results.records["learning"]
    for split in SPLITS:
        planned = [record for record in learning if record.meta["split"] == split]
        accepted = [record for record in planned if record.accepted]
        worn = Counter(name for record in accepted for name in record.meta["garments"])
        table.append(
            {"split": split, "samples": str(len(planned)), "accepted": str(len(accepted))}
            | {garment_title(garment): str(worn[garment]) for garment in GARMENTS}
        )
    return markdown(table)


def health(results: Results) -> str:
    """Measures of the samples by Blender beside their goals."""
    return _health(results, "blender")


def health_fast(results: Results) -> str:
    """The same of the samples by the fast solver."""
    return _health(results, "xpbd")


def _health(results: Results, solver: str) -> str:
    records = [
        record
        for published in (True, False)
        for record in results.accepted(published=published)
        if solver_name(record.meta) == solver
    ]
    table = []
    for measure in MEASURES.values():
        values = np.array([measure.values(record) for record in records])
        for place, end in enumerate(("low end", "", "high end")):
            if place not in measure.judged:
                continue
            column = values[:, place]
            low, high = measure.bounds
            goals = [f"at least {low:g}" if low is not None and place < 2 else "",
                     f"at most {high:g}" if high is not None and place > 0 else ""]  # fmt: skip
            table.append(
                {
                    "measure": ", ".join(filter(None, [measure.label, end])),
                    "mean of samples": f"{np.nanmean(column):.{measure.digits}f}",
                    "smallest": f"{np.nanmin(column):.{measure.digits}f}",
                    "largest": f"{np.nanmax(column):.{measure.digits}f}",
                    "goal": " ".join(filter(None, goals)) or "-",
                }
            )
    return markdown(table)


def times(results: Results) -> str:
    """Time and memory of each stage."""
    stages = results.times[results.times["rule"] == ALL_RULES]
    return markdown(
        {
            "stage": row.stage,
            "jobs": f"{row.jobs}",
            "processor time (s)": f"{row.cpu_s:.0f}",
            "share (%)": f"{100 * row.cpu_s / stages['cpu_s'].iloc[-1]:.0f}",
            "longest job (s)": f"{row.longest_s:.0f}",
            "peak memory of a job (MB)": f"{row.peak_memory_mb:.0f}",
        }
        for row in stages.itertuples()
    )


def costs(results: Results) -> str:
    """Time, memory and disk of a sample, step by step."""
    rows = results.times.set_index(["stage", "rule"])
    rows = {
        **{rule: row for (_, rule), row in rows.iterrows()},
        **{stage: row for (stage, rule), row in rows.iterrows() if rule == ALL_RULES},
    }
    solvers: dict[str, list[str]] = {}
    for group, records in results.records.items():
        solvers.setdefault(solver_name(records[0].meta), []).append(group)
    published = [
        group for group in results.records if (results.folder / "gallery" / group).is_dir()
    ]
    steps = [
        ("body in motion", "animate_bodies", "bodies", [*results.records]),
        *(
            (f"simulation by `{solver}`, and files", f"simulation, {solver}", "samples", groups)
            for solver, groups in solvers.items()
        ),
        ("registration to the body", "register_samples", "registration", [*results.records]),
        ("pictures", "render_gallery", "gallery", published),
    ]
    return markdown(
        {
            "what": title,
            "seconds of a core": f"{rows[name].cpu_s / count:.1f}",
            "MB of memory": f"{rows[name].peak_memory_mb:.0f}",
            "MB of files": f"{size / count / 1e6:.1f}",
        }
        for title, name, folder, groups in steps
        for count in [sum(len(results.records[group]) for group in groups)]
        for size in [sum(_bytes(results.folder / folder / group) for group in groups)]
    )


def _bytes(folder: Path) -> int:
    """What a folder takes of a disk."""
    return int(subprocess.check_output(["du", "--summarize", "--bytes", folder]).split()[0])


def _minutes(results: Results, rule: str = ALL_RULES) -> str:
    """Until the last job of a rule had ended, with two jobs side by side all the while."""
    jobs = _jobs(results)
    chosen = jobs if rule == ALL_RULES else jobs[jobs["rule"] == rule]
    if chosen.empty:
        raise SystemExit(f"{results.folder}: has no time of {rule}, expected a finished run")
    seconds = jobs.loc[jobs["ended_s"] <= chosen["ended_s"].max(), "s"].sum()
    return f"{seconds / 120:.0f} minutes"


def _jobs(results: Results) -> pd.DataFrame:
    return job_times([results.folder / "benchmarks", ROOT / "benchmarks"], {})


def usual_times(results: Results) -> dict[str, float]:
    """Mean seconds of a job of each rule."""
    return _jobs(results).groupby("rule")["s"].mean().round(1).to_dict()


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:.1f} GB"


FIGURES: dict[str, Callable[[Results], str]] = {
    "run": _minutes,
    "first": lambda results: _minutes(results, "write_overview"),
    "jobs": lambda results: f"{results.times['jobs'].iloc[-1]}",
    "core_hours": lambda results: f"{_jobs(results)['cpu_s'].sum() / 3600:.1f} core-hours",
    "memory": lambda results: _gigabytes(1e6 * results.times["peak_memory_mb"].max()),
    "disk": lambda results: _gigabytes(_bytes(results.folder)),
    "environment": lambda _: _gigabytes(_bytes((ROOT / ".venv").resolve())),
}


def markdown(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows as a table in Markdown; the best numbers are bold."""
    texts = [
        {
            title: f"**{cell}**" if "good" in getattr(cell, "classes", ()) else cell
            for title, cell in row.items()
        }
        for row in rows
    ]
    return f"{markdown_table(texts)}\n" if texts else "Not measured.\n"


def _metrics(table: MetricTable, results: Results) -> str:
    return markdown(table.rows(results.metrics))


TABLES: dict[str, Callable[[Results], str]] = {
    **{
        table.__name__: table
        for table in (origin, times, costs, health, health_fast, learning_group, registration)
    },
    **{name: partial(_metrics, table) for name, table in METRIC_TABLES.items()},
}


def write_tables(results: str | Path, pages: Iterable[Path] = PAGES) -> None:
    """Replace the tables and figures in pages; text outside of the marked places stays.

    Args:
        results: folder of a finished experiment.
        pages: Markdown.

    Raises:
        KeyError: a page has a place for a table or a figure that does not exist.
        InputError: the experiment lacks a file.
    """
    read = Results(Path(results))

    def table(match: re.Match[str]) -> str:
        return f"{match[1]}\n{TABLES[match[2]](read)}\n{match[3]}"

    def figure(match: re.Match[str]) -> str:
        return f"{match[1]}{FIGURES[match[2]](read)}{match[3]}"

    for page in pages:
        text = page.read_text()
        page.write_text(FIGURE.sub(figure, BLOCK.sub(table, text)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("results", type=Path, help="folder of results")
    parser.add_argument("--reference", action="store_true", help="of the reference experiment")
    asked = parser.parse_args()
    write_tables(asked.results, [REFERENCE] if asked.reference else PAGES)
    if not asked.reference:
        USUAL.write_text(json.dumps(usual_times(Results(asked.results)), indent=1) + "\n")
