"""A few damaged files of the most common formats, and the judge of `make fuzz` itself."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from drapeline.errors import InputError
from fuzz import runs
from fuzz.mutations import CANARY
from fuzz.runs import Loader, run_case

ROOT = Path(__file__).parents[2]
FEW = (
    *("amass", "bvh", "motion_table", "config", "body_pickle_2", "info", "obj", "scan_ply"),
    "released_decoder",
)


def test_damaged_files_are_read_or_refused_in_one_sentence():
    ended = subprocess.run(
        [sys.executable, "-m", "fuzz.run", "--cases", "5", "--seed", "9", "--loader", *FEW],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert f"{5 * len(FEW)} cases with seed 9" in ended.stdout


def refuse(message):
    def load(folder):
        raise InputError(message.format(file=folder / "a.txt"))

    return load


def fail(folder):
    raise KeyError("poses")


def take_memory(folder):
    bytearray(1 << 30)


def abort(folder):
    os.abort()


def loop(folder):
    while True:
        pass


def run_payload(folder):
    Path(CANARY).touch()


@pytest.mark.parametrize(
    ("load", "kind"),
    [
        (lambda folder: None, "read"),
        (refuse("{file}: damaged"), "refused"),
        (refuse("damaged"), "message"),
        (refuse("{file}: " + "damaged " * 200), "refused"),
        (fail, "traceback"),
        (take_memory, "memory"),
        (abort, "crash"),
        (loop, "hang"),
        (run_payload, "payload"),
    ],
)
def test_what_becomes_of_a_file_is_told_apart(tmp_path, monkeypatch, load, kind):
    monkeypatch.setattr(runs, "SECONDS", 1)
    files, scratch = tmp_path / "files", tmp_path / "scratch"
    (files / "x").mkdir(parents=True)
    scratch.mkdir()
    (files / "x" / "a.txt").write_text("1 2 3\n")
    loader = Loader("x", lambda folder: None, load)
    outcome = run_case(loader, 1, 0, files, scratch)
    assert outcome.kind == kind, outcome.told
    assert outcome.fine == (kind in ("read", "refused"))
    assert not list(scratch.iterdir())
    assert (files / "x" / "a.txt").read_text() == "1 2 3\n"
