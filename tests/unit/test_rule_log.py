"""Logs of rules, and how errors end a job."""

import logging
import sys
import threading
from pathlib import Path

import pytest

from drapeline.errors import DamagedFile, InputError
from drapeline.rule_log import progress, rule_log


def test_a_user_error_ends_the_job_with_its_sentence_and_a_traceback_in_the_log(tmp_path):
    path = tmp_path / "logs" / "rule.log"
    with pytest.raises(SystemExit, match="drapeline: a.bvh: 0 frames"), rule_log(str(path)):
        raise InputError("a.bvh: 0 frames, expected at least 1")
    assert "Traceback" in path.read_text()
    assert "a.bvh: 0 frames, expected at least 1" in path.read_text()


@pytest.mark.parametrize(
    ("file", "hint"),
    [
        ("results/static/data/offsets.npy", "; delete results/static/data and give the same"),
        ("results/motions/walk.npz", "; delete results/motions/walk.npz and give the same"),
        ("resources/body/female.npz", "; delete resources/body/female.npz and give the same"),
        ("resources/body/SMPL_FEMALE.npz", ""),
        ("mine/walk.npz", ""),
    ],
)
def test_a_damaged_file_that_a_rule_made_is_to_be_deleted(tmp_path, monkeypatch, file, hint):
    monkeypatch.chdir(tmp_path)
    made = tmp_path / "results/static/data"
    made.mkdir(parents=True)
    (made / ".snakemake_timestamp").touch()
    with pytest.raises(SystemExit) as caught, rule_log("results/logs/train/1.log"):
        raise DamagedFile(file, "cut off")
    command = " command again, which makes it anew" if hint else ""
    assert str(caught.value) == f"drapeline: {file}: cut off{hint}{command}"


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


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's disk that is full")
def test_a_full_disk_hides_no_reason_under_tracebacks_of_the_log(capfd):
    with (
        pytest.raises(SystemExit, match="drapeline: a.npz: cannot be written"),
        rule_log("/dev/full") as log,
    ):
        log.info("lost")
        raise InputError("a.npz: cannot be written (No space left on device)")
    assert capfd.readouterr().err == ""
    with rule_log("/dev/full") as log:  # a job that has room for its results succeeds
        log.info("lost")
    assert capfd.readouterr().err == ""


def test_what_a_thread_dies_of_is_for_the_log(tmp_path, capfd):
    def fail():
        raise OSError("no room for curves")

    with rule_log(str(tmp_path / "log")):
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
    assert capfd.readouterr().err == ""
    assert (
        "ERROR in another thread: no room for curves\nTraceback" in (tmp_path / "log").read_text()
    )


def test_a_log_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "logs").touch()
    path = tmp_path / "logs" / "rule.log"
    message = f"drapeline: {path}: cannot be written"
    with pytest.raises(SystemExit, match=message), rule_log(str(path)):
        pass


def test_progress_yields_everything_in_order(capsys):
    assert list(progress(range(5), label="frames")) == [0, 1, 2, 3, 4]
    assert not capsys.readouterr().err


def test_progress_draws_a_bar_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert list(progress(iter("ab"), total=2, label="frames")) == ["a", "b"]
    shown = capsys.readouterr().err
    assert "frames" in shown
    assert "2/2" in shown
