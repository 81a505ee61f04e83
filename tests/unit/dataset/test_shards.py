"""Samples in shards."""

import pytest

from drapeline.dataset.shards import samples_of
from drapeline.errors import InputError


def test_samples_come_in_order_without_what_a_killed_job_left(tmp_path):
    for name in ("001/L00021", "000/L00002", "000/L00001", "000/.L00003-half"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "000" / "about.json").write_text("{}")
    found = samples_of([tmp_path / "000", str(tmp_path / "001")])
    assert [path.name for path in found] == ["L00001", "L00002", "L00021"]


def test_a_missing_shard_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="002: no such folder, expected one with samples"):
        samples_of([tmp_path / "002"])
