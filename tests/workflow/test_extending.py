"""What docs/extending.md promises: additions touch the places it lists, and nothing else."""

import re

import pytest

from drapeline.experiment.source_digest import Sources
from drapeline.metrics.table import read_metrics, write_metrics
from snakemake_run import ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"

TOY_RULES = """
METRIC_TABLES["metrics"] += ["toy"]
DEFAULT_TARGETS += [f"{RESULTS}/report/toy_metrics.html"]


rule train_toy:
    input:
        data=static_data("train", "val"),
    output:
        directory(f"{RESULTS}/toy/model"),
    log:
        f"{LOGS}/train_toy.log",
    params:
        size=lookup(dpath="toy/size", within=config),
        code=source_hash("train_toy"),
    script:
        "../../scripts/train_toy.py"


rule evaluate_toy:
    input:
        model=f"{RESULTS}/toy/model",
        data=static_data(*EVALUATED_SPLITS),
    output:
        f"{RESULTS}/metrics/toy.tsv",
    log:
        f"{LOGS}/evaluate_toy.log",
    params:
        code=source_hash("evaluate_toy"),
    script:
        "../../scripts/evaluate_toy.py"


rule tabulate_toy:
    input:
        f"{RESULTS}/metrics.tsv",
    output:
        f"{RESULTS}/report/toy_metrics.html",
    log:
        f"{LOGS}/tabulate_toy.log",
    params:
        code=source_hash("tabulate_toy"),
    script:
        "../../scripts/tabulate_toy.py"
"""
TOY_SCHEMA = """
  toy:
    type: object
    additionalProperties: false
    default: {}
    properties:
      size: {type: integer, minimum: 1, default: 3, description: Numbers of the code.}
"""
TOY_EVALUATION = """
from drapeline.metrics.table import MetricRow, write_metrics
from drapeline.models.toy.model import MODEL

value = MetricRow(MODEL, MODEL, "test", "all", "surface_error_mm", 12.5, "mm", 1, 0)
write_metrics(snakemake.output[0], [value])
"""


def append(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as stream:
        stream.write(text)


def add_toy_model(project):
    """A model in the places that a model may touch."""
    append(project / "src/drapeline/models/toy/__init__.py", "")
    append(project / "src/drapeline/models/toy/model.py", 'MODEL = "toy"\n')
    append(project / "workflow/rules/toy.smk", TOY_RULES)
    append(project / "scripts/evaluate_toy.py", TOY_EVALUATION)
    for name in ("train_toy", "tabulate_toy"):
        append(project / f"scripts/{name}.py", "from drapeline.models.toy import model\n")
    append(project / "workflow/schemas/config.schema.yaml", TOY_SCHEMA)
    snakefile = project / "Snakefile"
    last = 'include: "workflow/rules/garment4d.smk"\n'
    text = snakefile.read_text()
    assert last in text
    snakefile.write_text(text.replace(last, last + 'include: "workflow/rules/toy.smk"\n'))


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    folder = copy_project(tmp_path_factory.mktemp("extended"))
    add_toy_model(folder)
    return folder


@pytest.fixture(scope="module")
def inputs(extended):
    """Rule -> input files, of one job of each rule that the tiny experiment has."""
    run = snakemake(extended, "all", "--dry-run", "--forceall", "--configfile", CONFIG)
    assert run.returncode == 0, run.stderr[-2000:]
    jobs = re.findall(r"^rule (\w+):\n(?:    input: (.*))?", run.stdout + run.stderr, re.MULTILINE)
    return {rule: files.split(", ") for rule, files in jobs}


def test_a_models_own_files_and_one_line_plan_it_with_all_the_rest(inputs):
    assert {"train_toy", "evaluate_toy", "tabulate_toy"} <= set(inputs)
    assert "results/tiny/metrics/toy.tsv" in inputs["collect_metrics"]
    # Times are taken of every step.
    assert "results/tiny/report/toy_metrics.html" in inputs["plot_time"]


def test_a_models_metrics_come_into_the_table(extended, inputs):
    """Really evaluated and collected, beside empty tables of the other models."""
    for name in inputs["collect_metrics"]:
        if not name.endswith("/toy.tsv"):
            write_metrics(extended / name, [])
    results = extended / "results/tiny"
    for name in ("toy/model", "static/data"):
        (results / name).mkdir(parents=True)
    run = snakemake(
        extended,
        *("--allowed-rules", "evaluate_toy", "collect_metrics", "--configfile", CONFIG),
        *("--", "results/tiny/metrics.tsv"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    (row,) = read_metrics(results / "metrics.tsv")
    assert (row.model, row.value) == ("toy", 12.5)


def test_a_new_model_makes_no_other_rule_run_again(extended):
    before, after = Sources(ROOT / "src"), Sources(extended / "src")
    for script in sorted((ROOT / "scripts").glob("*.py")):
        assert before.digest(script) == after.digest(extended / "scripts" / script.name)
