"""What a run says as it goes, on a terminal and in a log file."""

import os
import pty
import re
import subprocess
import sys

import pytest

from toys.snakemake_run import ROOT

SNAKEFILE = """
rule all:
    input: expand("{i}.txt", i=range(3)), "bad.txt"

rule good:
    output: "{i,[0-9]}.txt"
    log: "{i}.log"
    shell:
        "echo '12:00:00 INFO cloth: 7 of 60, 1.0 per s' > {log}; sleep 2;"
        " echo 'heard from {wildcards.i}' >&2; touch {output}"

rule bad:
    output: "bad.txt"
    log: "bad.log"
    shell: "echo what went wrong > {log}; exit 1"
"""
COMMAND = [
    *(sys.executable, "-m", "snakemake", "--cores", "1", "--keep-going", "--show-failed-logs"),
    *("--logger", "drapeline", "--quiet", "host"),
]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "Snakefile").write_text(SNAKEFILE)
    return tmp_path


def environment():
    return os.environ | {"PYTHONPATH": str(ROOT / "src"), "COLUMNS": "100"}


def finished(text):
    pattern = r"^\d\d:\d\d:\d\d good (\d) took \d+ s \((\d) of 5 done"
    return re.findall(pattern, text, re.MULTILINE)


def test_a_log_file_has_a_line_for_each_job_that_is_done(folder):
    run = subprocess.run(
        COMMAND, cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    assert "5 jobs to do, about 50 s by the default experiment's times" in run.stderr
    assert sorted(number for number, _ in finished(run.stderr)) == ["0", "1", "2"]
    assert [done for _, done in finished(run.stderr)] == ["1", "2", "3"]
    assert "what went wrong" in run.stderr
    assert "heard from 1" in run.stderr
    assert "cloth: 7 of 60" not in run.stderr
    assert "\r" not in run.stderr
    assert len(run.stderr.splitlines()) < 30


def test_a_terminal_shows_how_far_the_running_job_is(folder):
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        COMMAND, cwd=folder, env=environment(), stdout=theirs, stderr=theirs
    ) as run:
        os.close(theirs)
        text = ""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            text += piece.decode()
    os.close(ours)
    assert run.returncode == 1
    assert re.search(r"\d of 5 done, about .* left; good \d \(cloth: 7 of 60\)", text)
    lines = text.replace("\r\n", "\n")
    assert len(re.findall(r"good \d took", lines)) == 3
    assert re.search(r"^heard from 2$", re.sub(r".*\x1b\[K|.*\r", "", lines), re.MULTILINE)


def test_a_dry_run_is_snakemakes_own(folder):
    run = subprocess.run(
        [*COMMAND, "--dry-run"],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    text = run.stdout + run.stderr
    assert "This was a dry-run" in text
    assert re.search(r"^total +5$", text, re.MULTILINE)
