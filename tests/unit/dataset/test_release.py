"""A dataset as it is published: nothing in it is unlisted, unlicensed or unreadable."""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import yaml

import drapeline
from drapeline.dataset import release
from drapeline.dataset.card import released_card
from drapeline.dataset.collect import collect_dataset
from drapeline.dataset.release import release_dataset
from drapeline.dataset.tables import SAMPLES
from drapeline.errors import InputError
from drapeline.schema import read_table
from drapeline.storage import sweep
from toys.tiny_sample import write_tiny_sample

ROOT = Path(__file__).parents[3]
ABOUT = {"name": "toys", "creator": "Nobody", "version": "1.2.0"}
IDS = {"00001": "train", "00002": "train", "00003": "val", "00004": "test"}


def dataset_of(folder, body, name):
    """A collected dataset whose samples have the body under a name."""
    body = replace(body, name=name)
    samples = [
        write_tiny_sample(
            folder, body, sample, split, frames=12, source=f"c{sample}.bvh", seed=int(sample)
        ).folder
        for sample, split in IDS.items()
    ]
    collect_dataset(samples, folder / "dataset")
    return folder / "dataset"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, toy_body):
    return dataset_of(tmp_path_factory.mktemp("made"), toy_body, "drapeline-anny-female-1")


@pytest.fixture(scope="module")
def released(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("published") / "release"
    release_dataset(dataset, folder, **ABOUT)
    return folder


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_sums_are_of_all_files_but_their_own(released):
    lines = (released / "SHA256SUMS").read_text().splitlines()
    listed = {name: found for found, name in (line.split("  ") for line in lines)}
    files = {path for path in released.rglob("*") if path.is_file()}
    assert {released / name for name in listed} == files - {released / "SHA256SUMS"}
    assert listed == {name: digest(released / name) for name in listed}


def test_the_index_has_the_rows_of_samples_with_ids_as_text_and_measures_as_numbers(released):
    index = pd.read_parquet(released / "samples.parquet")
    rows = pd.read_csv(released / "samples.tsv", sep="\t", dtype=str, keep_default_na=False)
    assert list(index) == list(rows)
    assert list(index["sample"]) == list(IDS)
    assert set(index["frames"]) == {12}
    numbers = {name for name in index if pd.api.types.is_numeric_dtype(index[name])}
    assert {"frames", "megabytes", "inside_share_mean", "inside_share_max"} <= numbers
    assert not numbers & {"sample", "split", "garments", "source"}
    for name in index:
        found, written = list(index[name]), list(rows[name])
        assert found == (list(map(float, written)) if name in numbers else written)


def test_the_card_is_that_of_the_dataset_under_a_free_licence(dataset, released):
    card = (released / "README.md").read_text()
    header = yaml.safe_load(card.split("---\n")[1])
    assert header["license"] == "cc-by-4.0"
    assert header["configs"] == [{"config_name": "samples", "data_files": "samples.parquet"}]
    assert "license: other" not in card
    assert "keep their licences: a dataset made with a licensed SMPL" not in card
    licence = card.partition("## Licence")[2]
    assert "only as far as these allow. Clips used: " in licence
    assert "Attribution 4.0" in (released / "LICENSE").read_text()
    found, made = (
        text.partition("## Contents")[2].partition("## Licence")[0]
        for text in (card, (dataset / "README.md").read_text())
    )
    assert "## Format" in made
    assert found == made


@pytest.mark.parametrize("lacking", ["license: other", "  data_files: samples.tsv", "keep their"])
def test_a_card_that_lacks_what_a_release_changes_is_no_card(dataset, lacking):
    card = (dataset / "README.md").read_text()
    assert lacking in card
    with pytest.raises(ValueError, match="the card lacks"):
        released_card(card.replace(lacking, ""))


def test_machines_are_told_of_every_column_and_the_index_itself(released):
    told = json.loads((released / "croissant.json").read_text())
    assert {key: told[key] for key in ("name", "version")} == {"name": "toys", "version": "1.2.0"}
    assert told["creator"]["name"] == "Nobody"
    assert "4 sequences" in told["description"]
    index = pd.read_parquet(released / "samples.parquet")
    (records,) = told["recordSet"]
    kinds = {"i": "sc:Integer", "f": "sc:Float", "O": "sc:Text"}
    assert {field["name"]: field["dataType"] for field in records["field"]} == {
        name: kinds[index[name].dtype.kind] for name in index
    }
    assert records["key"]["@id"] in {field["@id"] for field in records["field"]}
    file, *sets = told["distribution"]
    assert {field["source"]["fileObject"]["@id"] for field in records["field"]} == {file["@id"]}
    assert file["sha256"] == digest(released / file["contentUrl"])
    for one in sets:
        assert list(released.glob(one["includes"]))


def test_a_release_is_a_dataset(dataset, released):
    found = drapeline.open_dataset(released)
    found.verify()
    assert found.ids == list(IDS)
    for one, made in zip(found, drapeline.open_dataset(dataset), strict=True):
        assert (one.vertices("Skirt") == made.vertices("Skirt")).all()


def test_its_loader_prints_a_line_per_sample_with_numpy_and_scipy_alone(released):
    banned = ("torch", "pandas", "fastparquet", "snakemake", "bpy", "anny", "trimesh", "matplotlib")
    code = (
        "import runpy, sys\n"
        f"for name in {banned}: sys.modules[name] = None\n"
        "runpy.run_path('load.py')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=released,
        env={"PYTHONPATH": str(ROOT / "src"), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["00001", "00002"]
    assert all("(10, 60, 3) (10, " in line for line in lines)


def test_a_dataset_is_released_again_over_what_was_there(dataset, tmp_path):
    (tmp_path / "release").mkdir()
    (tmp_path / "release" / "old.txt").write_text("old")
    release_dataset(dataset, tmp_path / "release", **ABOUT)
    assert not (tmp_path / "release" / "old.txt").exists()
    assert (tmp_path / "release" / "LICENSE").is_file()
    drapeline.open_dataset(tmp_path / "release").verify()


def test_what_another_run_sweeps_is_not_what_is_being_released(dataset, tmp_path, monkeypatch):
    write = release.write_parquet

    def sweep_first(path, table):
        assert sweep(tmp_path) == []
        write(path, table)

    monkeypatch.setattr(release, "write_parquet", sweep_first)
    release_dataset(dataset, tmp_path / "release", **ABOUT)
    assert read_table(tmp_path / "release" / "samples.tsv", SAMPLES)["sample"].tolist() == [*IDS]


def test_bodies_that_may_not_be_passed_on_are_named(tmp_path, toy_body):
    made = dataset_of(tmp_path, toy_body, "basicmodel_f_lbs_10_207_0_v1.1.0")
    sentence = r"dataset: has bodies of basicmodel_f_lbs_\S+, whose licence does not let you pass"
    with pytest.raises(InputError, match=sentence):
        release_dataset(made, tmp_path / "release", **ABOUT)
    assert not (tmp_path / "release").exists()


def test_a_damaged_file_is_not_published(tmp_path, toy_body):
    made = dataset_of(tmp_path, toy_body, "drapeline-anny-male-1")
    path = made / "train" / "00002" / "Skirt.obj"
    path.write_bytes(bytes(path.stat().st_size))
    with pytest.raises(InputError, match=r"00002/Skirt\.obj: its SHA-256 sum is not the one in"):
        release_dataset(made, tmp_path / "release", **ABOUT)
    assert not (tmp_path / "release").exists()
