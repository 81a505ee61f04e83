"""Shards of samples, and what they deliver."""

from pathlib import Path

import pytest

from drapeline.errors import InputError
from drapeline.experiment.shards import deliver, files_in_shard, shard_samples, shard_settings


def test_every_sample_is_in_one_shard_in_its_order():
    shards = shard_samples([f"{i:05d}" for i in range(1, 8)], 3)
    assert list(shards) == ["000", "001", "002"]
    assert [len(members) for members in shards.values()] == [3, 3, 1]
    assert [name for members in shards.values() for name in members] == [
        f"{i:05d}" for i in range(1, 8)
    ]


def test_without_a_size_there_are_no_shards():
    assert shard_samples(["00001"], None) == {}


def test_the_settings_of_a_shard_make_samples_one_by_one():
    given = {"results": "results", "seed": 3, "samples": {"count": 9, "shard_size": 2}}
    made = shard_settings(given, "results/shards/000")
    assert made == {
        "results": "results/shards/000",
        "seed": 3,
        "samples": {"count": 9, "shard_size": None},
    }
    assert given["samples"]["shard_size"] == 2


@pytest.fixture
def files(tmp_path):
    results, shard = tmp_path / "results", tmp_path / "results/shards/000"
    (shard / "samples/00001").mkdir(parents=True)
    (shard / "samples/00001/info.mat").write_text("info")
    (shard / "gallery").mkdir()
    (shard / "gallery/00001.png").write_text("picture")
    outputs = [f"{results}/samples/00001", f"{results}/gallery/00001.png"]
    return files_in_shard(outputs, str(results), str(shard))


def test_files_and_folders_are_moved_to_the_results(files, tmp_path):
    deliver(files)
    assert (tmp_path / "results/samples/00001/info.mat").read_text() == "info"
    assert (tmp_path / "results/gallery/00001.png").read_text() == "picture"
    assert not any(path.exists() for path in files)


def test_nothing_is_moved_where_something_is_missing(files):
    picture = next(path for path in files if path.suffix == ".png")
    picture.unlink()
    with pytest.raises(InputError, match=r"00001\.png and 0 more of 2 files could not be made"):
        deliver(files)
    assert all(path.exists() for path in files if path != picture)
    assert not any(Path(target).exists() for target in files.values())
