import csv
from pathlib import Path

import numpy as np
import pytest

from drapeline.dataset.collect import accepted_records, collect_dataset, outcome
from drapeline.dataset.reader import Cloth3D
from drapeline.dataset.record import SampleRecord, meta_path, read_meta
from drapeline.dataset.tables import ACTIONS, GARMENTS_WORN, OVERVIEW, SAMPLES, STATUS
from drapeline.errors import DamagedFile, InputError
from drapeline.manifest import MANIFEST, read_manifest, sum_file
from drapeline.schema import read_table
from drapeline.storage import write_json
from toys.tiny_sample import write_tiny_sample


def rows_of(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, toy_body):
    stages = tmp_path_factory.mktemp("stages")
    plan = [
        ("00001", "train", "accepted", 6, "female"),
        ("00002", "train", "accepted", 4, "male"),
        ("00003", "val", "rejected", 6, "female"),
        ("00004", "test", "accepted", 2, "female"),
    ]
    folders = [
        write_tiny_sample(
            stages, toy_body, name, split, status=status, frames=n, gender=g, source=f"c{name}.bvh"
        ).folder
        for name, split, status, n, g in plan
    ]
    collect_dataset(reversed(folders), stages / "dataset")
    return stages / "dataset"


def test_accepted_samples_are_in_their_splits_and_rejected_ones_in_none(dataset):
    assert Cloth3D(dataset).ids == ["00001", "00002", "00004"]
    assert Cloth3D(dataset, "train").ids == ["00001", "00002"]
    assert list((dataset / "val").iterdir()) == []


def test_accepted_samples_of_all_splits_come_by_id(dataset):
    records = accepted_records(dataset)
    assert [record.meta["id"] for record in records] == ["00001", "00002", "00004"]
    assert all(record.accepted for record in records)


def test_published_files_are_copies_that_may_be_spoilt(dataset):
    for split in ("train", "test"):
        for path in (dataset / split).rglob("*.*"):
            made_from = dataset.parent / "samples" / path.relative_to(dataset / split)
            assert path.read_bytes() == made_from.read_bytes()
            assert not path.samefile(made_from)


def test_the_manifest_lists_every_file_with_its_sum(dataset):
    files = [path for path in dataset.rglob("*") if path.is_file()]
    listed = read_manifest(dataset / MANIFEST)
    assert {dataset / name for name in listed} | {dataset / MANIFEST} == set(files)
    for name, wanted in listed.items():
        assert sum_file(dataset / name) == wanted
    Cloth3D(dataset).verify()


def test_a_sample_that_was_cut_off_is_not_published(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body).folder
    cut = folder / "info.mat"
    cut.write_bytes(cut.read_bytes()[:-1])
    with pytest.raises(DamagedFile, match=r"info\.mat: \d+ bytes, expected \d+ as in"):
        collect_dataset([folder], tmp_path / "dataset")
    assert not (tmp_path / "dataset").exists()


def test_what_changed_unseen_keeps_the_sum_that_it_had_when_it_was_written(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body).folder
    (obj,) = folder.glob("Skirt.obj")
    obj.write_bytes(bytes(obj.stat().st_size))
    collect_dataset([folder], tmp_path / "dataset")
    with pytest.raises(DamagedFile, match=r"Skirt\.obj: its SHA-256 sum is not the one in"):
        Cloth3D(tmp_path / "dataset").verify()


def test_status_lists_every_sample_with_its_reason(dataset):
    rows = {row["sample"]: row for row in rows_of(dataset / "status.tsv")}
    assert list(rows) == ["00001", "00002", "00003", "00004"]
    assert rows["00003"]["status"] == "rejected"
    assert rows["00003"]["reason"] == "1.20 % of the vertices inside the body"
    assert rows["00001"]["attempts"] == "1"
    assert rows["00001"]["removed_segments"] == "left_hand+right_hand"


def test_every_table_is_of_its_schema(dataset):
    for name, schema, count in (
        ("status", STATUS, 4),
        ("samples", SAMPLES, 3),
        ("statistics_actions", ACTIONS, 1),
        ("statistics_garments", GARMENTS_WORN, 2),
    ):
        assert len(read_table(dataset / f"{name}.tsv", schema)) == count
    assert read_table(dataset / "statistics_overview.tsv", OVERVIEW)["all"].iloc[0] == "3"


def test_samples_table_has_a_row_per_accepted_sample(dataset):
    rows = rows_of(dataset / "samples.tsv")
    assert [row["sample"] for row in rows] == ["00001", "00002", "00004"]
    first = rows[0]
    assert (first["gender"], first["garments"]) == ("female", "Tshirt+Skirt")
    assert (first["frames"], first["vertices"]) == ("6", "140")
    assert float(first["inside_share_max"]) == pytest.approx(0.01)


def test_edge_length_is_the_mean_of_the_rest_mesh(dataset):
    sample = Cloth3D(dataset)[0]
    mesh = sample.mesh("Skirt")
    sides = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, -1, axis=1)]
    # Every edge of a tube but those of its two ends lies on two faces.
    edges = {}
    for face, lengths in zip(mesh.faces, np.linalg.norm(sides, axis=-1), strict=True):
        for a, b, length in zip(face, np.roll(face, -1), lengths, strict=True):
            edges[frozenset((int(a), int(b)))] = length
    assert sample.meta["garments"]["Skirt"]["edge_m"] == pytest.approx(
        np.mean(list(edges.values())), abs=1e-6
    )


def test_collecting_again_replaces_the_dataset(tmp_path, toy_body):
    folders = [write_tiny_sample(tmp_path, toy_body, f"0000{i}").folder for i in (1, 2)]
    collect_dataset(folders, tmp_path / "dataset")
    collect_dataset(folders[1:], tmp_path / "dataset")
    assert Cloth3D(tmp_path / "dataset").ids == ["00002"]
    assert (folders[0] / "info.mat").is_file()


def test_a_dataset_of_rejected_samples_alone_still_says_why(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body, status="failed").folder
    collect_dataset([folder], tmp_path / "dataset")
    assert len(rows_of(tmp_path / "dataset" / "status.tsv")) == 1
    assert "0 sequences" in (tmp_path / "dataset" / "README.md").read_text()


def test_unusable_samples_are_named(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body).folder
    with pytest.raises(InputError, match="sample 00001 is given twice"):
        collect_dataset([folder, folder], tmp_path / "dataset")
    meta = read_meta(folder)
    del meta["motion"]
    write_json(meta_path(folder), meta)
    with pytest.raises(InputError, match=r"meta.json: lacks motion"):
        collect_dataset([folder], tmp_path / "dataset")
    assert not (tmp_path / "dataset").exists()


def record(number, status="accepted", reason=""):
    meta = {"id": f"{number:05}", "status": status, "reason": reason}
    return SampleRecord(Path("."), meta, 0, 0)


@pytest.mark.parametrize(
    ("rejected", "words"),
    [
        ([], "4 of 4 samples accepted"),
        (
            ["depth_m 0.04, expected at most 0.03"],
            "4 of 5 samples accepted (1 rejected: depth_m 0.04, expected at most 0.03)",
        ),
        (
            [
                "slip_m 0.3, expected at most 0.25",
                "slip_m 0.4, expected at most 0.25; depth_m 1, expected at most 0.03",
                "hands in thighs",
            ],
            "4 of 7 samples accepted (2 rejected by slip_m, 1 rejected by hands in thighs)",
        ),
    ],
)
def test_what_came_of_samples_is_a_sentence(rejected, words):
    others = [record(9, "rejected", reason) for reason in rejected]
    assert outcome([*map(record, range(4)), *others]) == words
