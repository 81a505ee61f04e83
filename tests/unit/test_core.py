"""Small parts of the core: seeds, rule logs, preflight."""

import logging

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.preflight import missing_libraries, problems
from drapeline.rule_log import progress, rule_log
from drapeline.seeding import rng_for


def test_streams_depend_on_seed_and_names_only():
    draw = rng_for(0, "shape", "00001").random(4)
    np.testing.assert_array_equal(draw, rng_for(0, "shape", "00001").random(4))
    for other in [(1, "shape", "00001"), (0, "pose", "00001"), (0, "shape", "00002"), (0, "shape")]:
        assert not np.allclose(draw, rng_for(*other).random(4))


def test_names_are_not_glued_together():
    assert rng_for(1, "ab", "c").random() != rng_for(1, "a", "bc").random()


def test_a_user_error_ends_the_job_with_its_sentence_and_a_traceback_in_the_log(tmp_path):
    path = tmp_path / "logs" / "rule.log"
    with pytest.raises(SystemExit, match="drapeline: a.bvh: 0 frames"), rule_log(str(path)):
        raise InputError("a.bvh: 0 frames, expected at least 1")
    assert "Traceback" in path.read_text()
    assert "a.bvh: 0 frames, expected at least 1" in path.read_text()


def test_a_bug_keeps_its_traceback(tmp_path):
    path = tmp_path / "rule.log"
    with pytest.raises(ZeroDivisionError), rule_log(str(path)):
        _ = 1 / 0
    assert "ZeroDivisionError" in path.read_text()


def test_log_files_of_two_rules_do_not_mix(tmp_path):
    for name in ("one", "two"):
        with rule_log(str(tmp_path / name)) as log:
            log.info("this is %s", name)
    assert "this is two" not in (tmp_path / "one").read_text()
    assert "this is two" in (tmp_path / "two").read_text()
    assert not logging.getLogger("drapeline").handlers


def test_a_log_begins_anew_but_for_processes_of_further_devices(tmp_path, monkeypatch):
    path = tmp_path / "log"
    for rank, text in ((None, "old"), ("0", "first"), ("1", "second")):
        if rank is not None:
            monkeypatch.setenv("LOCAL_RANK", rank)
        with rule_log(str(path)) as log:
            log.info("this is %s", text)
    assert [text in path.read_text() for text in ("old", "first", "second")] == [False, True, True]


def test_progress_yields_everything_in_order():
    assert list(progress(range(5), label="frames")) == [0, 1, 2, 3, 4]


def test_preflight_is_silent_where_all_is_there(tmp_path):
    assert problems(tmp_path, (3, 11), "Linux", {"libc.so.6": "libc6"}, 100) == []


def test_preflight_names_each_lack_in_one_sentence(tmp_path):
    found = problems(tmp_path, (3, 12), "Linux", {"libnone.so.9": "libnone9"}, 0.5)
    assert len(found) == 3
    assert "Python 3.12 is running" in found[0]
    assert "libnone.so.9" in found[1]
    assert "apt-get install libnone9" in found[1]
    assert "0.5 GB of disk are free" in found[2]


def test_missing_libraries_asks_the_linker():
    assert missing_libraries(["libc.so.6", "libnone.so.9"]) == ["libnone.so.9"]
