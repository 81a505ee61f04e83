"""Every example plans what it promises, by the command that stands in it."""

import re
import shlex

import pytest
import yaml

from drapeline.experiment.config import fill_settings
from toys.plans import files_of
from toys.schema import SCHEMA
from toys.snakemake_run import ROOT, snakemake

EXAMPLES = sorted((ROOT / "examples").glob("*.yaml"))
DATASET = {
    *("copy_body", "import_motion", "animate_bodies", "build_templates", "make_outfits"),
    *("simulate_outfits", "write_samples", "collect_dataset", "dataset"),
}


def command(path):
    """Arguments of the command in the example's comment."""
    line = re.search(r"^# +\.venv/bin/snakemake (.*)$", path.read_text(), re.MULTILINE)
    return shlex.split(line[1])


@pytest.fixture(scope="module")
def jobs(project):
    """Rule -> number of its jobs that an example plans."""
    smpl = project / "smpl"
    smpl.mkdir()
    for gender in ("FEMALE", "MALE"):
        (smpl / f"SMPL_{gender}.pkl").touch()

    def planned(name):
        run = snakemake(project, "--dry-run", *command(ROOT / f"examples/{name}.yaml"))
        text = run.stdout + run.stderr
        assert run.returncode == 0, text[-2000:]
        stats = re.findall(r"^(\w+) +(\d+)$", text, re.MULTILINE)
        return {rule: int(count) for rule, count in stats if rule != "total"}

    return planned


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_fit_the_schema_and_name_only_what_they_change(path):
    given = yaml.safe_load(path.read_text())
    fill_settings(given, SCHEMA, path.name)
    default = fill_settings({}, SCHEMA, "")
    for group, values in given.items():
        pairs = values.items() if isinstance(values, dict) else [(group, values)]
        known = default[group] if isinstance(values, dict) else default
        for key, value in pairs:
            assert value != known[key], f"{path.name} repeats the default of {group}.{key}"


def test_the_readme_lists_every_example():
    listed = re.findall(r"^\| \[(\w+)\.yaml\]", (ROOT / "examples/README.md").read_text(), re.M)
    assert sorted(listed) == [path.stem for path in EXAMPLES]


@pytest.mark.parametrize(
    ("name", "clips", "samples"),
    [("dresses", 1, 100), ("own_motion", 3, 4), ("own_garment", 3, 6), ("own_body", 3, 6)],
)
def test_examples_plan_the_dataset_and_nothing_else(jobs, name, clips, samples):
    planned = jobs(name)
    assert planned.keys() == DATASET - ({"copy_body"} if name == "own_body" else set())
    assert planned["import_motion"] == clips
    assert planned["simulate_outfits"] == samples


def test_scans_are_reconstructed_by_networks_of_the_default_experiment(jobs):
    planned = jobs("scans")
    moving = files_of("config.yaml").moving
    assert planned["simulate_outfits"] == sum(len(group.shards) for group in moving)
    assert planned["reconstruct_garment"] == 1
    assert planned["train"] == 2  # labels, and our model


def test_pictures_are_fitted_by_models_of_the_default_experiment(jobs):
    planned = jobs("pictures")
    assert planned["fit_picture"] == planned["plot_fitted_picture"] == 1
    assert planned["train"] == 4
    assert "simulate_outfits" not in planned
