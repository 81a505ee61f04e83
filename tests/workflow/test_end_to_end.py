"""The tiny size, really made: bodies, outfits, Blender, dataset, pictures, report.

The environment variable DRAPELINE_TINY names a folder in which it is made already.
"""

import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from drapeline.dataset.reader import Cloth3D
from drapeline.geometry.mesh import edges
from drapeline.rendering.raytracer import ray_share
from toys.made import made_tiny
from toys.notebooks import run_notebook
from toys.snakemake_run import ROOT, copy_project, snakemake

TINY = "tests/data/tiny.yaml"
SETTINGS = yaml.safe_load((ROOT / TINY).read_text())
EXPERIMENT = ["--configfile", TINY]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A project with the tiny experiment: the one that is made, or a copy where it is made."""
    if (made := made_tiny()) is not None:
        return made
    folder = copy_project(tmp_path_factory.mktemp("tiny"))
    run = snakemake(folder, "all", *EXPERIMENT, many_jobs=True)
    assert run.returncode == 0, run.stderr[-4000:]
    return folder


@pytest.fixture(scope="module")
def results(project):
    return project / SETTINGS["results"]


@pytest.fixture(scope="module")
def made(results):
    return Cloth3D(results / "dataset")


def test_every_sample_is_accounted_for_and_most_are_accepted(made, results):
    status = pd.read_csv(results / "dataset" / "status.tsv", sep="\t", dtype={"sample": str})
    assert list(status["sample"]) == ["00001", "00002", "00003"]
    assert set(status["status"]) <= {"accepted", "rejected", "failed"}
    assert (status["status"] == "accepted").sum() >= 2
    clips = SETTINGS["motions"]["sequences"]
    assert set(status["sequence"].str.removesuffix("_s0")) <= set(clips)
    assert len(made) == (status["status"] == "accepted").sum()


def test_garments_are_quads_of_the_length_asked_for_and_keep_it_when_simulated(made):
    wanted = SETTINGS["outfits"]["edge_length_m"]
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
        health = sample.meta["health"]
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


def test_every_array_is_documented(results):
    codes = re.findall(r"`([^`]+)`", (ROOT / "docs/reference/data-format.md").read_text())
    documented = {word for code in codes for word in re.findall(r"\w+", code)}
    for path in sorted(results.rglob("*.np[yz]")):
        keys = [path.stem]
        if path.suffix == ".npz":
            keys = [name.removesuffix(".npy") for name in zipfile.ZipFile(path).namelist()]
        for key in keys:
            *parents, name = key.split("/")
            name = re.sub(r"(?<=_)\d+$", "", name)  # levels of the hierarchy
            assert name in documented or "landmarks" in parents, f"{path.name}: {key}"


def test_a_second_run_has_nothing_to_do(project):
    run = snakemake(project, "all", "--dry-run", *EXPERIMENT)
    assert "Nothing to be done" in run.stdout + run.stderr


def test_the_report_is_one_page_that_needs_no_network(project):
    page = project / "report.html"
    if made_tiny() is None:
        run = snakemake(project, "--report", str(page), *EXPERIMENT)
        assert run.returncode == 0, run.stderr[-2000:]
    text = page.read_text()
    for word in ("00001", "Gallery", "Health", "Dataset", "Time"):
        assert word in text
    assert len(text) > 500_000


def test_the_tour_runs_on_these_results(results):
    # Networks of this size have learned nothing, so they may find no garment at all.
    given = {"RESULTS": str(results), "LEAST_SHARE": 0}
    with ray_share(0.05):
        made, pictures = run_notebook(ROOT / "examples" / "tour.ipynb", given)
    assert len(pictures) == 4
    for picture in pictures:
        assert np.asarray(picture).std() > 5
    assert made["moving"].vertices.shape == made["true"][made["rows"]].shape
    assert len(made["codes"].mean) == 1


def bad_and_good_clip(folder, **dataset):
    """A config of two samples, the first on a clip that is damaged."""
    with np.load(ROOT / "workflow/resources/motions/walk.npz") as archive:
        arrays = dict(archive)
    np.savez(folder / "good.npz", **arrays)
    arrays["poses"] = arrays["poses"].copy()
    arrays["poses"][5, 3 * 18 + 1] = np.nan
    np.savez(folder / "bad.npz", **arrays)
    table = folder / "clips.tsv"
    table.write_text("name\tfile\nbad\tbad.npz\ngood\tgood.npz\n")
    settings = {
        "results": str(folder / "results"),
        "motions": {"table": str(table), "sequences": [], "frames": 12, "frames_min": 12},
        "groups": {"dataset": {"count": 2, **dataset}},
    }
    (folder / "mine.yaml").write_text(yaml.safe_dump(settings))
    return folder / "mine.yaml"


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """A copy of the project in which nothing but the bodies is made."""
    return copy_project(tmp_path_factory.mktemp("fresh"))


def test_a_bad_clip_fails_alone_in_one_sentence(fresh, tmp_path):
    config = bad_and_good_clip(tmp_path)
    wanted = [str(tmp_path / "results/bodies/dataset" / f"0000{k}") for k in (1, 2)]
    run = snakemake(fresh, "--keep-going", *wanted, "--configfile", str(config))
    assert run.returncode != 0
    assert not Path(wanted[0]).exists()
    assert Path(wanted[1]).exists()
    log = (tmp_path / "results" / "logs" / "import_motion" / "bad_whole.log").read_text()
    assert "bad.npz" in log
    assert "drapeline: " in run.stderr
    assert "left_elbow" in run.stderr


def test_a_shard_is_made_in_one_job_of_each_step(fresh, tmp_path):
    config, results = bad_and_good_clip(tmp_path, shard_size=2), tmp_path / "results"
    shutil.copy(tmp_path / "good.npz", tmp_path / "bad.npz")
    wanted = [str(results / "registration/dataset/00001"), "--configfile", TINY, str(config)]
    run = snakemake(fresh, *wanted)
    assert run.returncode == 0, run.stderr[-2000:]
    for step in ("bodies", "outfits", "simulation", "samples", "registration"):
        (shard,) = (results / step / "dataset").iterdir()
        made = {path.stem for path in shard.iterdir() if not path.name.startswith(".")}
        assert made == {"00001", "00002"}
