"""Write the tables of docs/reference/results.md from one finished experiment.

    .venv/bin/python docs/write_tables.py RESULTS

Replaces what stands between `<!-- table: NAME -->` and `<!-- end of table -->` there.
RESULTS is the folder of results within the checkout that made them.
"""

import argparse
import re
import subprocess
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.dataset.record import SampleRecord, read_record
from drapeline.dataset.shards import samples_of_shards
from drapeline.dataset.splits import SPLITS
from drapeline.dataset.tables import read_table
from drapeline.metrics.fitted_scans import CLASSES, COMMON
from drapeline.metrics.table import ALL, HIGH, LOW, find_value, read_metrics
from drapeline.models.smplicit.variants import FIELD_MODELS
from drapeline.outfits.garment_types import GARMENTS, TEMPLATE_TYPES
from drapeline.report.dataset.health import MEASURES
from drapeline.report.times import step_times

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/reference/results.md"
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
NAMES = {"Tshirt": "t-shirt"} | {name: name.lower() for name in GARMENTS if name != "Tshirt"}
STATIC = {
    "static_ppca": "masked PPCA (ours)",
    "svae": "garment VAE",
    "pca": "PCA of offsets",
    "mean_garment": "mean garment of the type",
    "nearest_cvar": "nearest training garment in the conditions",
}
DYNAMIC = {
    "dynamic_ppca_settled": "masked PPCA (ours), pushed out of the body",
    "dynamic_ppca": "masked PPCA (ours)",
    "dvae_unposed_4": "garment VAE",
    "skinned_static": "garment at rest, skinned",
    "skinned_mean": "mean garment of the type, skinned",
}
CANONICAL = {
    "canonical": "canonical stage",
    "regression": "regression alone, which it starts from",
    "pointnet": "PN++ (baseline)",
    "mean_garment": "mean garment of the type",
    "pca": "true coefficients (lower bound)",
}
LABELS = {
    "canonical": CANONICAL["canonical"],
    "label_by_vertex": "most common training label at the nearest vertex of the body",
    "one_label": "most common training label",
}
POSED = {
    "lbs": "interpolated skinning",
    "untrained": "posed stage, untrained",
    "mgn": "MGN* (baseline)",
    "posed": "posed stage, as trained",
    "ours": "our final step",
}
CODES = {
    "static_ppca": "masked PPCA (ours)",
    "garment4d_pca": "PCA of Garment4D's templates",
    "body_pca": "PCA of offsets",
    "smplicit": "SMPLicit, fitted code",
    "svae": "garment VAE",
    "body_registered": "registered to the body, no code",
    "template_registered": "registered to the template, no code",
}
FIELD_VARIANTS = {
    "fitted": "fitted code",
    "nearest_cut": "nearest training garment in z_cut",
    "nearest_style": "nearest training garment in z_style",
    "mean_code": "mean code",
}
PICTURES = {
    "smplicit_images_hung": "hung: of three outfits the one most like the picture (ours)",
    "smplicit_images_nearest_hung": "training code with the least loss, hung as well",
    "smplicit_images_mean_code_hung": "mean code of the class, hung as well",
    "smplicit_images_fitted": "fitted code, skinned",
    "smplicit_images_fitted_in_pair": "the same with two people in a picture, one behind the other",
    "smplicit_images_nearest": "training code with the least loss, skinned",
    "smplicit_images_mean_code": "mean code of the class, skinned",
}
SCANS = {
    "smplicit_scan_start": "SMPLicit, mean code on the estimated body",
    "smplicit_scan_nearest": "SMPLicit, training code with the least loss",
    "smplicit_scan_code": "SMPLicit, fitted code",
    "smplicit_scan_joint": "SMPLicit, code and body fitted jointly",
    "smplicit_scan_nearest_hung": "SMPLicit, training code with the least loss, hung",
    "smplicit_scan_hung": "SMPLicit, code fitted again to cloth that hangs",
    "static_ppca_scan": "masked PPCA (ours), fitted code",
    "svae_scan": "garment VAE, fitted code",
    "garment4d_scan_pca": "PCA of Garment4D's templates, fitted",
    "garment4d_scan_posed": "Garment4D's networks",
    "smplicit_scan_hung_moved": "SMPLicit, hung, then moved to the points",
    "smplicit_scan_moved": "SMPLicit, skinned, then moved to the points",
    "static_ppca_scan_moved": "masked PPCA (ours), skinned, then moved to the points",
    "svae_scan_moved": "garment VAE, skinned, then moved to the points",
    "garment4d_scan_moved": "PCA of Garment4D's templates, skinned, then moved to the points",
    "garment4d_scan_ours": "Garment4D's networks, then moved to the points",
}
# Stage -> the files whose rules belong to it.
STAGES = {
    "bodies, motion, outfits": ("bodies", "outfits"),
    "cloth simulation": ("simulation",),
    "learning group": ("learning_samples",),
    "dataset, pictures, report": ("dataset", "renders", "report", "evaluation"),
    "registration and data for learning": ("registration", "learning_data"),
    "garment VAEs": ("gcvae", "gcvae_figures"),
    "Garment4D": ("garment4d", "garment4d_figures"),
    "SMPLicit": ("smplicit", "smplicit_figures", "smplicit_images", "smplicit_scans"),
    "scans": ("scans",),
}

# Table over all garments -> its rows, and its columns: metric, decimals and factor.
BY_METRIC = {
    "static": (
        STATIC,
        {
            "surface error mm": ("surface_error_mm", 2, 1.0),
            "normals deg": ("normal_error_deg", 1, 1.0),
            "mask IoU": ("mask_iou", 3, 1.0),
        },
    ),
    "dynamic": (
        DYNAMIC,
        {
            "surface error mm": ("surface_error_mm", 1, 1.0),
            "normals deg": ("normal_error_deg", 1, 1.0),
            "inside the body %": ("inside_share", 2, 100.0),
        },
    ),
    "representations": (
        CODES,
        {
            "numbers": ("code_numbers", 0, 1.0),
            "to the truth mm": ("surface_to_true_mm", 2, 1.0),
            "back mm": ("true_to_surface_mm", 2, 1.0),
        },
    ),
    "smplicit_images": (
        PICTURES,
        {
            "silhouette IoU": ("silhouette_iou", 2, 1.0),
            "better than the mean code %": ("better_than_mean_share", 0, 100.0),
            "labels right %": ("segmentation_accuracy", 0, 100.0),
            "to the truth mm": ("surface_to_true_mm", 0, 1.0),
            "back mm": ("true_to_surface_mm", 0, 1.0),
        },
    ),
}
# Table with a column per garment type -> its rows, types, metric, decimals and factor.
BY_TYPE = {
    "static_by_type": (STATIC, GARMENTS, "surface_error_mm", 1, 1.0),
    "dynamic_by_type": (DYNAMIC, GARMENTS, "surface_error_mm", 1, 1.0),
    "canonical": (CANONICAL, TEMPLATE_TYPES, "canonical_error_mm", 1, 1.0),
    "labels": (LABELS, TEMPLATE_TYPES, "segmentation_accuracy", 1, 100.0),
    "posed": (POSED, TEMPLATE_TYPES, "vertex_error_mm", 1, 1.0),
    "posed_surface": (POSED, TEMPLATE_TYPES, "predicted_to_true_mm", 1, 1.0),
    "posed_surface_back": (POSED, TEMPLATE_TYPES, "true_to_predicted_mm", 1, 1.0),
    "acceleration": (
        {"still": "a garment that never moves"} | POSED,
        TEMPLATE_TYPES, "acceleration_error_m_s2", 2, 1.0,
    ),
    "contact": (
        {"truth": "ground truth itself"} | POSED, TEMPLATE_TYPES, "inside_share", 2, 100.0
    ),
}  # fmt: skip

Table = list[dict[str, str]]


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
        self.metrics = [row for row in read_metrics(folder / "metrics.tsv") if row.split == "test"]
        samples = sorted(path for path in (folder / "samples").iterdir() if path.is_dir())
        records = map(read_record, samples)
        self.records: list[SampleRecord] = [record for record in records if record.accepted]
        group = folder / "learning" / "samples"
        shards = sorted(group.iterdir()) if group.is_dir() else []
        self.learning = list(map(read_record, samples_of_shards(shards)))

    def value(
        self,
        variant: str,
        garment: str,
        metric: str,
        digits: int,
        scale: float = 1.0,
        source: str = "",
    ) -> str:
        """A metric with its interval, or a dash."""
        found = [
            find_value(self.metrics, variant, "test", garment, metric + end, source)
            for end in ("", LOW, HIGH)
        ]
        if found[0] is None:
            return "-"
        numbers = [f"{scale * row.value:.{digits}f}" for row in found if row]
        interval = f" ({numbers[1]} to {numbers[2]})" if len({*numbers[1:]}) == 2 else ""
        return numbers[0] + interval

    def by_metric(
        self, variants: Mapping[str, str], columns: Mapping[str, tuple[str, int, float]]
    ) -> Table:
        """A row for each model that was measured, over all garments."""
        return [
            {"model": name}
            | {title: self.value(variant, ALL, *column) for title, column in columns.items()}
            for variant, name in variants.items()
            if any(self.has(variant, column[0]) for column in columns.values())
        ]

    def by_type(
        self,
        variants: Mapping[str, str],
        types: Sequence[str],
        metric: str,
        digits: int,
        scale: float,
    ) -> Table:
        """A row for each model that was measured, a column for each garment type."""
        found = {row.garment for row in self.metrics if row.metric == metric}
        return [
            {"model": name}
            | {NAMES[g]: self.value(variant, g, metric, digits, scale) for g in types if g in found}
            for variant, name in variants.items()
            if self.has(variant, metric)
        ]

    def has(self, variant: str, metric: str) -> bool:
        """Whether a model was measured."""
        return any((row.variant, row.metric) == (variant, metric) for row in self.metrics)


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
    seeds = sorted({row.seed for row in results.metrics})
    held_out = max((row.n for row in results.metrics if row.variant == "static_ppca"), default=0)
    posed = [row for row in results.metrics if (row.variant, row.split) == ("posed", "test")]
    moving = sorted({row.n for row in posed if not row.source})
    return (
        f"Commit {commit}, seed {', '.join(map(str, seeds))}, one training of each model."
        f" {len(results.records)} samples by Blender, and"
        f" {sum(record.accepted for record in results.learning)} of {len(results.learning)} by the"
        f" fast solver that were accepted; the test split has {held_out} garments at"
        f" rest, and {_span(moving)} moving sequences of"
        " each of Garment4D's types. Brackets hold 95 % intervals over outfits, or over sequences"
        " where garments move; they do not cover what another seed would change.\n"
    )


def by_solver(results: Results) -> str:
    """Garments in motion, measured on the samples of each cloth solver."""
    sources = sorted({row.source for row in results.metrics} - {""})
    wanted = [
        *((name, "surface error mm", variant, ALL, "surface_error_mm")
          for variant, name in DYNAMIC.items()),
        *((f"{name}, {NAMES[garment]}", title, variant, garment, metric)
          for garment in TEMPLATE_TYPES
          for variant, name, title, metric in (
              ("regression", "regression alone", "M1 mm", "canonical_error_mm"),
              ("canonical", "Garment4D, canonical stage", "M1 mm", "canonical_error_mm"),
              ("untrained", "Garment4D, posed stage, untrained", "M2 mm", "vertex_error_mm"),
              ("posed", "Garment4D, posed stage", "M2 mm", "vertex_error_mm"),
              ("ours", "our final step", "M2 mm", "vertex_error_mm"),
          )),
    ]  # fmt: skip
    table = []
    for name, title, variant, garment, metric in wanted:
        cells = {}
        for source in sources:
            row = find_value(results.metrics, variant, "test", garment, metric, source)
            text = results.value(variant, garment, metric, 1, source=source).split(" ")[0]
            cells[source] = f"{text} (of {row.n})" if row else "-"
        table.append({"model": name, "measure": title} | cells)
    return markdown(table)


def registration(results: Results) -> str:
    """From the garment to offsets and back, by type."""
    rows = read_table(results.folder / "report" / "registration.tsv")
    shown = {
        "garment to rebuilt mm": "garment_to_rebuilt_mean_mm",
        "rebuilt to garment mm": "rebuilt_to_garment_mean_mm",
        "area lost %": "area_lost_percent",
    }
    found = {(row["garment"], row["metric"]): row for row in rows if row["source"] == "static"}
    table = []
    for garment in GARMENTS:
        if (garment, "area_lost_percent") not in found:
            continue
        cells = {title: found[garment, metric] for title, metric in shown.items()}
        table.append(
            {"garment": NAMES[garment], "garments": cells["area lost %"]["garments"]}
            | {
                title: f"{float(cell['mean']):.2f} (worst {float(cell['max']):.2f})"
                for title, cell in cells.items()
            }
        )
    return markdown(table)


def learning_group(results: Results) -> str:
    """Samples of the learning group by split, and the garments of those that were accepted."""
    table = []
    for split in SPLITS:
        planned = [record for record in results.learning if record.meta["split"] == split]
        accepted = [record for record in planned if record.accepted]
        worn = Counter(name for record in accepted for name in record.meta["garments"])
        table.append(
            {"split": split, "samples": str(len(planned)), "accepted": str(len(accepted))}
            | {NAMES[garment]: str(worn[garment]) for garment in GARMENTS}
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


def smplicit(results: Results) -> str:
    """Held-out garments at rest: a row for each model and what it is compared with."""
    columns = {
        "to the truth mm": ("surface_to_true_mm", 1, 1.0),
        "back mm": ("true_to_surface_mm", 1, 1.0),
        "normals deg": ("normal_error_deg", 1, 1.0),
        "openings right %": ("openings_right", 0, 100.0),
    }
    rows = []
    for model in FIELD_MODELS:
        variants = {f"smplicit_{model}_{key}": name for key, name in FIELD_VARIANTS.items()}
        rows += [
            {"garments": model, **row, "openings right %": row["openings right %"].split(" ")[0]}
            for row in results.by_metric(variants, columns)
        ]
    return markdown(rows)


def scans(results: Results) -> str:
    """All models fitted to the same scans, in both directions and by class."""
    table = []
    for variant, name in SCANS.items():
        found = find_value(results.metrics, variant, "test", ALL, "surface_to_true_mm")
        if found is not None:
            to_true, back = (
                results.value(variant, ALL, metric, 1)
                for metric in ("surface_to_true_mm", "true_to_surface_mm")
            )
            by_class = {
                part: results.value(variant, part, "surface_to_true_mm", 1).split(" ")[0]
                for part in (*CLASSES, COMMON)
                if any(one.garment == part for one in results.metrics)
            }
            row = {"fit": name, "garments": str(found.n), "to the truth mm": to_true}
            table.append(row | {"back mm": back} | by_class)
    return markdown(table)


def times(results: Results) -> str:
    """Processor time and memory of each stage."""
    steps = step_times([results.folder / "benchmarks", ROOT / "resources" / "benchmarks"])
    table, whole = [], defaultdict(float)
    for stage, files in STAGES.items():
        rules = set().union(*(rules_of(name) for name in files))
        found = [step for step in steps if step.rule in rules]
        if not found:
            continue
        jobs = sum(len(step.seconds) for step in found)
        # One core each; Snakemake's count of processor time misses the last half minute of a job.
        seconds = sum(sum(step.seconds) for step in found)
        memory = max(step.memory_mb or 0.0 for step in found)
        longest = max(max(step.seconds) for step in found)
        whole["jobs"] += jobs
        whole["seconds"] += seconds
        table.append(
            {
                "stage": stage,
                "jobs": str(jobs),
                "seconds": f"{seconds:.0f}",
                "longest job s": f"{longest:.0f}",
                "peak memory MB": f"{memory:.0f}",
            }
        )
    total = {"stage": "all", "jobs": f"{whole['jobs']:.0f}"}
    return markdown([*table, total | {"seconds": f"{whole['seconds']:.0f}"}])


def rules_of(file: str) -> set[str]:
    """Names of the rules in a file of the workflow."""
    text = (ROOT / "workflow" / "rules" / f"{file}.smk").read_text()
    return set(re.findall(r"^rule (\w+):", text, re.MULTILINE))


def markdown(rows: Table) -> str:
    """Rows as a table in Markdown, with the columns of all rows in order of appearance."""
    if not rows:
        return "Not measured.\n"
    columns = list(dict.fromkeys(column for row in rows for column in row))
    lines = [columns, ["---"] * len(columns)]
    lines += [[row.get(column, "") for column in columns] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


TABLES: dict[str, Callable[[Results], str]] = {
    **{
        table.__name__: table
        for table in (
            *(origin, times, health, health_learning, learning_group, registration),
            *(smplicit, scans, by_solver),
        )
    },
    **{
        name: lambda results, given=given: markdown(results.by_metric(*given))
        for name, given in BY_METRIC.items()
    },
    **{
        name: lambda results, given=given: markdown(results.by_type(*given))
        for name, given in BY_TYPE.items()
    },
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
