"""docs/tutorial.md: its files are accepted, its code runs, and its commands plan what it says."""

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
import yaml

from drapeline.geometry.obj import load_obj
from drapeline.outfits.user_garment import openings
from toys.snakemake_run import ROOT, snakemake

TEXT = (ROOT / "docs/tutorial.md").read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def blocks(language):
    return [text for name, text in BLOCKS if name == language]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a reader has after step 7."""
    folder = tmp_path_factory.mktemp("tutorial")
    (folder / "examples").symlink_to(ROOT / "examples")
    (table,) = [text for text in blocks("bash") if "clips.tsv" in text]
    subprocess.run(["sh", "-c", table], cwd=folder, check=True)
    config, dress = blocks("yaml")
    (folder / "mine.yaml").write_text(config)
    merged = yaml.safe_load(config) | yaml.safe_load(dress)
    (folder / "worn.yaml").write_text(yaml.safe_dump(merged))
    (code,) = [text for text in blocks("python") if "save_obj" in text]
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True)
    return folder


def planned(folder, *arguments):
    """Rule -> number of its jobs."""
    run = snakemake(folder, "--dry-run", "--snakefile", str(ROOT / "Snakefile"), *arguments)
    text = run.stdout + run.stderr
    assert run.returncode == 0, text[-2000:]
    return dict(re.findall(r"^(\w+) +(\d+)$", text, re.MULTILINE))


def test_the_dataset_has_as_many_samples_as_the_tutorial_says(folder):
    jobs = planned(folder, "dataset", "--configfile", "mine.yaml")
    assert jobs["simulate_outfits"] == "2"
    assert "render_gallery" not in jobs


def test_its_targets_are_made_by_rules(folder):
    commands = [
        shlex.split(line.partition("snakemake ")[2])
        for block in blocks("bash")
        for line in block.replace("\\\n", "").splitlines()
        if ".venv/bin/snakemake" in line
    ]
    assert len(commands) == 2
    jobs = planned(folder, *commands[0])
    assert {"render_gallery", "view_sample", "export_sample"} <= jobs.keys()
    jobs = planned(folder, *("worn.yaml" if word == "mine.yaml" else word for word in commands[1]))
    assert {"render_gallery", "collect_dataset"} <= jobs.keys()


def test_the_dress_is_shorter_and_wider(folder):
    theirs, own = load_obj(ROOT / "examples/data/dress.obj"), load_obj(folder / "my_dress.obj")
    assert {"top", "bottom", "sleeves"} <= openings(own).keys()
    assert own.vertices[:, 2].min() > theirs.vertices[:, 2].min() + 0.05
    assert np.ptp(own.vertices[:, 0]) > np.ptp(theirs.vertices[:, 0]) + 0.05
