"""What is missing on a machine."""

import pytest

from drapeline.preflight import find_problems, find_slurm_problem, missing_libraries


def test_preflight_is_silent_where_all_is_there(tmp_path):
    assert find_problems(tmp_path, (3, 11), "Linux", {"libc.so.6": "libc6"}, 100) == []


def test_preflight_names_each_lack_in_one_sentence(tmp_path):
    found = find_problems(tmp_path, (3, 12), "Linux", {"libnone.so.9": "libnone9"}, 0.5)
    assert len(found) == 3
    assert "Python 3.12 is running" in found[0]
    assert "libnone.so.9" in found[1]
    assert "apt-get install libnone9" in found[1]
    assert "only 0.5 GB of free disk space" in found[2]


def test_missing_libraries_asks_the_linker():
    assert missing_libraries(["libc.so.6", "libnone.so.9"]) == ["libnone.so.9"]


ACCOUNTS = {"AccountingStorageType": "accounting_storage/slurmdbd", "MinJobAge": "2 sec"}
NO_ACCOUNTS = {"AccountingStorageType": "accounting_storage/none", "MinJobAge": "300 sec"}


@pytest.mark.parametrize(("asking", "settings"), [("sacct", ACCOUNTS), ("squeue", NO_ACCOUNTS)])
def test_a_cluster_that_tells_when_jobs_end_is_no_problem(asking, settings):
    assert find_slurm_problem(asking, settings) is None


@pytest.mark.parametrize(
    ("asking", "settings", "problem"),
    [
        ("sacct", NO_ACCOUNTS, "add --slurm-status-command squeue"),
        ("squeue", {**NO_ACCOUNTS, "MinJobAge": "60 sec"}, "forgets jobs 60 s after their end"),
        ("squeue", {}, "scontrol does not answer here"),
    ],
)
def test_a_cluster_that_does_not_is_named_with_what_helps(asking, settings, problem):
    assert problem in find_slurm_problem(asking, settings)
