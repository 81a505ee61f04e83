"""The tiny size, really made: bodies, outfits, Blender, dataset, pictures, report."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from drapeline.dataset.reader import Cloth3D
from drapeline.geometry.mesh import edges
from snakemake_run import ROOT, snakemake

CONFIG = "tests/data/tiny.yaml"
RESULTS = ROOT / yaml.safe_load((ROOT / CONFIG).read_text())["results"]


@pytest.fixture(scope="module")
def made():
    """The tiny experiment, made by the same command that users type."""
    run = snakemake("all", "--configfile", CONFIG)
    assert run.returncode == 0, run.stderr[-4000:]
    return Cloth3D(RESULTS / "dataset")


def test_every_sample_is_accounted_for_and_most_are_accepted(made):
    status = pd.read_csv(RESULTS / "dataset" / "status.tsv", sep="\t", dtype={"sample": str})
    assert list(status["sample"]) == ["00001", "00002", "00003"]
    assert set(status["status"]) <= {"accepted", "rejected", "failed"}
    assert (status["status"] == "accepted").sum() >= 2
    assert len(made) == (status["status"] == "accepted").sum()


def test_garments_are_quads_of_the_length_asked_for_and_keep_it_when_simulated(made):
    wanted = yaml.safe_load((ROOT / CONFIG).read_text())["outfits"]["edge_length_m"]
    for sample in made:
        assert len(sample) == 12
        for name in sample.garments:
            mesh = sample.mesh(name)
            assert mesh.faces.shape[1] == 4
            pairs = edges(mesh.faces)
            rest = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
            assert 0.6 * wanted < rest.mean() < 1.5 * wanted
            moving = sample.vertices(name, frame="root")
            assert np.isfinite(moving).all()
            length = np.linalg.norm(moving[:, pairs[:, 0]] - moving[:, pairs[:, 1]], axis=2)
            assert 0.95 < np.median(length / rest) < 1.05
            assert np.abs(moving).max() < 2


def test_cloth_stays_outside_the_body_and_on_it(made):
    for sample in made:
        health = json.loads((sample.folder / "meta.json").read_text())["health"]
        assert health["inside_share"]["mean"] < 0.01
        for name in sample.garments:
            # No garment lies on the floor or flies: its centre stays near the root joint.
            centre = sample.vertices(name, frame="root").mean(axis=1)
            assert np.abs(centre).max() < 0.7


def test_splits_share_no_clip_and_no_body(made):
    clips, shapes = {}, {}
    for sample in made:
        clips.setdefault(sample.split, set()).add(sample.meta["motion"]["source"])
        shapes.setdefault(sample.split, set()).add(tuple(sample.info.shape))
    for parts in (clips, shapes):
        together = [item for items in parts.values() for item in items]
        assert len(together) == len(set(together))


@pytest.mark.usefixtures("made")
def test_every_array_is_documented():
    codes = re.findall(r"`([^`]+)`", (ROOT / "docs" / "data-format.md").read_text())
    documented = {word for code in codes for word in re.findall(r"\w+", code)}
    for path in sorted(RESULTS.rglob("*.np[yz]")):
        keys = [path.stem]
        if path.suffix == ".npz":
            keys = [name.removesuffix(".npy") for name in zipfile.ZipFile(path).namelist()]
        for key in keys:
            *parents, name = key.split("/")
            name = re.sub(r"(?<=_)\d+$", "", name)  # levels of the hierarchy
            assert name in documented or "landmarks" in parents, f"{path.name}: {key}"


@pytest.mark.usefixtures("made")
def test_a_second_run_has_nothing_to_do():
    run = snakemake("all", "--dry-run", "--configfile", CONFIG)
    assert "Nothing to be done" in run.stdout + run.stderr


@pytest.mark.usefixtures("made")
def test_the_report_is_one_page_that_needs_no_network(tmp_path):
    page = tmp_path / "report.html"
    run = snakemake("--report", str(page), "--configfile", CONFIG)
    assert run.returncode == 0, run.stderr[-2000:]
    text = page.read_text()
    for word in ("00001", "Gallery", "Health", "Dataset", "Time"):
        assert word in text
    assert len(text) > 500_000


@pytest.mark.usefixtures("made")
def test_a_bad_clip_fails_alone_in_one_sentence(tmp_path):
    with np.load(ROOT / "workflow/resources/motions/walk.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "good.npz", **arrays)
    arrays["poses"] = arrays["poses"].copy()
    arrays["poses"][5, 3 * 18 + 1] = np.nan
    np.savez(tmp_path / "bad.npz", **arrays)
    table = tmp_path / "clips.tsv"
    table.write_text("name\tfile\nbad\tbad.npz\ngood\tgood.npz\n")
    config = tmp_path / "mine.yaml"
    settings = {
        "results": str(tmp_path / "results"),
        "motions": {"table": str(table), "sequences": [], "frames": 12, "frames_min": 12},
        "samples": {"count": 2},
    }
    config.write_text(yaml.safe_dump(settings))
    wanted = [str(tmp_path / "results" / "bodies" / f"0000{k}.npz") for k in (1, 2)]
    run = snakemake("--keep-going", "--nolock", *wanted, "--configfile", str(config))
    assert run.returncode != 0
    assert not Path(wanted[0]).exists()
    assert Path(wanted[1]).exists()
    log = (tmp_path / "results" / "logs" / "import_motion" / "bad.log").read_text()
    assert "bad.npz" in log
    assert "drapeline: " in run.stderr
    assert "left_elbow" in run.stderr
