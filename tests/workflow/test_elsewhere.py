"""The workflow started in another folder, and as a module of another workflow."""

import re

import pytest
import yaml

from toys.plans import files_of
from toys.snakemake_run import ROOT, snakemake

MODULE = """
configfile: "config/config.yaml"


module drapeline:
    snakefile:
        "{snakefile}"
    config:
        config


use rule * from drapeline as drapeline_*


rule count:
    input:
        rules.drapeline_dataset.input,
"""


def planned(run):
    text = run.stdout + run.stderr
    assert run.returncode == 0, text[-3000:]
    return dict(re.findall(r"^(\w+) +(\d+)$", text, re.MULTILINE))


@pytest.fixture
def folder(tmp_path):
    """An empty folder with a small config of its own in `config/`."""
    (tmp_path / "config").mkdir()
    settings = {"groups": {"dataset": {"count": 2}}, "motions": {"sequences": ["walk", "run"]}}
    (tmp_path / "config/config.yaml").write_text(yaml.safe_dump(settings))
    return tmp_path


def test_another_folder_gets_the_default_experiment(project, folder):
    jobs = planned(
        snakemake(folder, "--dry-run", "dataset", "--snakefile", str(project / "Snakefile"))
    )
    published = files_of("config.yaml").published
    assert jobs["simulate_outfits"] == str(sum(len(group.shards) for group in published))
    clips = {clip for group in published for clip in group.clips}
    assert jobs["import_motion"] == str(len(clips))


def test_a_config_in_the_folder_comes_first(project, folder):
    (folder / "config/config.yaml").rename(folder / "config.yaml")
    arguments = ["--snakefile", str(project / "Snakefile"), "--directory", str(folder)]
    assert planned(snakemake(project, "--dry-run", "dataset", *arguments))["import_motion"] == "2"


@pytest.mark.parametrize("snakefile", ["Snakefile", "workflow/Snakefile"])
def test_a_module_makes_the_dataset_of_another_workflow(project, folder, snakefile):
    (folder / "Snakefile").write_text(MODULE.format(snakefile=project / snakefile))
    run = snakemake(folder, "--dry-run", "count")
    jobs = planned(run)
    assert jobs["drapeline_simulate_outfits"] == "2"
    assert jobs["drapeline_import_motion"] == "2"
    assert "walk.npz" in run.stdout + run.stderr


def test_a_workflow_of_the_module_alone_makes_everything_by_default(project, folder):
    (folder / "config/config.yaml").write_text((ROOT / "config.yaml").read_text())
    text = MODULE.format(snakefile=project / "Snakefile")
    (folder / "Snakefile").write_text(text.partition("rule count")[0])
    jobs = planned(snakemake(folder, "--dry-run"))
    assert {"drapeline_all", "drapeline_train", "drapeline_evaluate"} <= jobs.keys()


def test_the_module_in_the_docs_is_this_one():
    page = ROOT / "docs/how-to/run-elsewhere.md"
    documented = re.search(r"```snakemake\n(.*?)```", page.read_text(), re.S)[1]
    path = "/path/to/drapeline/workflow/Snakefile"
    assert MODULE.format(snakefile=path).lstrip().startswith(documented)


def test_what_the_catalog_reads_is_there():
    assert (ROOT / "config/config.yaml").resolve() == (ROOT / "config.yaml").resolve()
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())["usage"]
    assert usage["software-stack-deployment"]["conda"] is True
    assert {"snakemake", "workflow"} <= set((ROOT / "README.md").read_text().lower().split())
