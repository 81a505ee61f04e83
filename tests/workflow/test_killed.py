"""What a killed run leaves behind, and what to type after it."""

import socket

import pytest

from drapeline.manifest import write_manifest
from toys.snakemake_run import copy_project, snakemake

CONFIG = ["--configfile", "tests/data/tiny.yaml"]
MOTION = "results/tiny/motions/punch/whole.npz"


@pytest.fixture
def killed(tmp_path):
    """A project in which a job was killed that was writing, and Snakemake with it."""
    project = copy_project(tmp_path)
    scrap = project / f"results/tiny/samples/dataset/.writing-00001@{socket.gethostname()}.abc"
    scrap.mkdir(parents=True)
    (scrap / "info.mat").touch()
    locks = project / ".snakemake/locks"
    locks.mkdir(parents=True)
    (locks / "0.output.lock").write_text(f"{MOTION}\n")
    return project


def test_after_a_kill_the_lock_is_removed_by_hand_and_scraps_by_themselves(killed):
    target = [MOTION, "--cores", "1", *CONFIG]
    refused = snakemake(killed, *target)
    assert refused.returncode != 0
    assert "--unlock" in refused.stdout + refused.stderr  # Snakemake says what to type
    assert snakemake(killed, "--unlock", *CONFIG).returncode == 0
    assert snakemake(killed, *target, "--dry-run").returncode == 0
    (scrap,) = (killed / "results/tiny/samples/dataset").iterdir()  # a dry run removes nothing
    run = snakemake(killed, *target)
    text = " ".join((run.stdout + run.stderr).split())
    assert run.returncode == 0, text
    assert not scrap.exists()
    assert f"Removed {scrap.relative_to(killed)}, which a killed job was writing." in text


def test_verify_says_what_is_damaged_and_makes_nothing(tmp_path):
    project = copy_project(tmp_path)
    model = project / "results/tiny/gcvae/svae"
    model.mkdir(parents=True)
    (model / "best.safetensors").write_text("weights")
    write_manifest(model)
    verify = ["verify", "--cores", "1", *CONFIG]
    for content, code, said in (
        ("weights", 0, "drapeline: all files are as they were written (1 compared, "),
        (
            "weight",
            1,
            "1 file is damaged (results/tiny/gcvae/svae/best.safetensors: 6 bytes, expected 7",
        ),
    ):
        (model / "best.safetensors").write_text(content)
        run = snakemake(project, *verify)
        text = " ".join((run.stdout + run.stderr).split())
        assert (run.returncode != 0) == code, text
        assert said in text
    assert {path.name for path in (project / "results/tiny").iterdir()} == {
        *("gcvae", "logs"),
    }
