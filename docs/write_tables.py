"""Write the tables of docs/reference/results.md from one finished experiment.

    .venv/bin/python docs/write_tables.py RESULTS

Replaces what stands between `<!-- table: NAME -->` and `<!-- end of table -->` there.
RESULTS is the folder of results within the checkout that made them.
"""

import argparse
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from drapeline.dataset.card import markdown_table
from drapeline.dataset.record import SampleRecord, read_record
from drapeline.dataset.shards import samples_of
from drapeline.dataset.splits import SPLITS
from drapeline.metrics.properties import CLASSES, COMMON
from drapeline.metrics.registry import variants
from drapeline.metrics.table import ALL
from drapeline.outfits.garment_types import GARMENTS, TEMPLATE_TYPES
from drapeline.report.dataset.health import MEASURES
from drapeline.report.registration_table import SUMMARY
from drapeline.report.tables import MetricTable, garment_title, read_test_metrics
from drapeline.report.times import job_times
from drapeline.schema import read_table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/reference/results.md"
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
STATIC = ("static_ppca", "svae", "pca", "mean_garment", "nearest_cvar")
DYNAMIC = (
    *("dynamic_ppca_settled", "dynamic_ppca", "dvae_unposed_4"),
    *("skinned_static", "skinned_mean"),
)
POSED = ("lbs", "untrained", "mgn", "posed", "ours")
HELD = ("fitted", "nearest_cut", "nearest_style", "mean_code")
SURFACES = ("surface_to_true_mm", "true_to_surface_mm")
# Stage -> the files whose rules belong to it.
STAGES = {
    "bodies, motion, outfits": ("bodies", "outfits"),
    "cloth simulation": ("simulation",),
    "dataset, pictures, report": ("dataset", "renders", "report", "evaluation"),
    "registration and data for learning": ("registration", "learning_data"),
    "garment VAEs": ("gcvae", "gcvae_figures"),
    "Garment4D": ("garment4d", "garment4d_figures"),
    "SMPLicit": ("smplicit", "smplicit_figures", "smplicit_images", "smplicit_scans"),
    "scans": ("scans",),
}

by_type = partial(MetricTable, across="garment", count="")
METRIC_TABLES = {
    "static": MetricTable(STATIC, ("surface_error_mm", "normal_error_deg", "mask_iou"), count=""),
    "static_by_type": by_type(STATIC, ["surface_error_mm"], GARMENTS),
    "dynamic": MetricTable(
        DYNAMIC, ("surface_error_mm", "normal_error_deg", "inside_share"), count=""
    ),
    "dynamic_by_type": by_type(DYNAMIC, ["surface_error_mm"], GARMENTS),
    "canonical": by_type(
        ("canonical", "regression", "pointnet", "mean_garment", "pca"),
        ["canonical_error_mm"],
        TEMPLATE_TYPES,
    ),
    "labels": by_type(
        ("canonical", "label_by_vertex", "one_label"), ["segmentation_accuracy"], TEMPLATE_TYPES
    ),
    "posed": by_type(POSED, ["vertex_error_mm"], TEMPLATE_TYPES),
    "posed_surface": by_type(POSED, ["predicted_to_true_mm"], TEMPLATE_TYPES),
    "posed_surface_back": by_type(POSED, ["true_to_predicted_mm"], TEMPLATE_TYPES),
    "acceleration": by_type(("still", *POSED), ["acceleration_error_m_s2"], TEMPLATE_TYPES),
    "contact": by_type(("truth", *POSED), ["inside_share"], TEMPLATE_TYPES),
    "by_solver": MetricTable(
        (*DYNAMIC, "regression", "canonical", "untrained", "posed", "ours"),
        ("surface_error_mm", "canonical_error_mm", "vertex_error_mm"),
        (*TEMPLATE_TYPES, ALL),
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
        records: its accepted samples.
        learning: those of its learning group, rejected ones too.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.metrics = read_test_metrics(folder / "metrics.tsv")
        records = _records(folder, "dataset")
        self.records: list[SampleRecord] = [record for record in records if record.accepted]
        self.learning = _records(folder, "learning")


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
    held_out = metrics.loc[metrics["variant"] == "static_ppca", "n"].max()
    moving = sorted(metrics.loc[metrics["variant"] == "posed", "n"].unique())
    return (
        f"Commit {commit}, seed {', '.join(map(str, seeds))}, one training of each model."
        f" {len(results.records)} samples by Blender, and"
        f" {sum(record.accepted for record in results.learning)} of {len(results.learning)} by the"
        f" fast solver that were accepted; the test split has {held_out} garments at"
        f" rest, and {_span(moving)} moving sequences of"
        " each of Garment4D's types. Brackets hold 95 % intervals over outfits, or over sequences"
        " where garments move; they do not cover what another seed would change.\n"
    )


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


def _records(folder: Path, group: str) -> list[SampleRecord]:
    """Of all samples of a group, rejected ones too."""
    shards = sorted((folder / "samples" / group).glob("[!.]*"))
    return list(map(read_record, samples_of(shards)))


def learning_group(results: Results) -> str:
    """Samples of the learning group by split, and the garments of those that were accepted."""
    table = []
    for split in SPLITS:
        planned = [record for record in results.learning if record.meta["split"] == split]
        accepted = [record for record in planned if record.accepted]
        worn = Counter(name for record in accepted for name in record.meta["garments"])
        table.append(
            {"split": split, "samples": str(len(planned)), "accepted": str(len(accepted))}
            | {garment_title(garment): str(worn[garment]) for garment in GARMENTS}
        )
    return markdown(table)


def health(results: Results) -> str:
    """Measures of the dataset's samples beside their goals."""
    return _health(results.records)


def health_learning(results: Results) -> str:
    """The same of the learning group."""
    return _health([record for record in results.learning if record.accepted])


def _health(records: Sequence[SampleRecord]) -> str:
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
    """Processor time and memory of each stage."""
    jobs = job_times([results.folder / "benchmarks", ROOT / "resources" / "benchmarks"])
    stage_of = {
        rule: stage for stage, files in STAGES.items() for name in files for rule in rules_of(name)
    }
    # One core each; Snakemake's count of processor time misses the last half minute of a job.
    by = jobs.assign(stage=pd.Categorical(jobs["rule"].map(stage_of), STAGES)).groupby(
        "stage", observed=True
    )
    table = pd.DataFrame(
        {
            "jobs": by.size(),
            "seconds": by["s"].sum().map("{:.0f}".format),
            "longest job s": by["s"].max().map("{:.0f}".format),
            "peak memory MB": by["memory_mb"].max().map("{:.0f}".format),
        }
    )
    whole = {"jobs": by.size().sum(), "seconds": f"{by['s'].sum().sum():.0f}"}
    rows = [{"stage": stage, **row} for stage, row in table.to_dict("index").items()]
    return markdown([*rows, {"stage": "all"} | whole])


def rules_of(file: str) -> set[str]:
    """Names of the rules in a file of the workflow."""
    text = (ROOT / "workflow" / "rules" / f"{file}.smk").read_text()
    return set(re.findall(r"^rule (\w+):", text, re.MULTILINE))


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
        for table in (origin, times, health, health_learning, learning_group, registration)
    },
    **{name: partial(_metrics, table) for name, table in METRIC_TABLES.items()},
}


def write_tables(results: str | Path, page: Path = PAGE) -> None:
    """Replace the tables in a page; text outside of the marked places stays.

    Args:
        results: folder of a finished experiment.
        page: Markdown.

    Raises:
        KeyError: the page has a place for a table that does not exist.
        InputError: the experiment lacks a file.
    """
    read = Results(Path(results))

    def replace(match: re.Match[str]) -> str:
        return f"{match[1]}\n{TABLES[match[2]](read)}\n{match[3]}"

    page.write_text(BLOCK.sub(replace, page.read_text()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("results", type=Path, help="folder of results")
    write_tables(parser.parse_args().results)
