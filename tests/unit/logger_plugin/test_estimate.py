import json
import time
from importlib.resources import files

import pytest

from snakemake_logger_plugin_drapeline.estimate import Estimate, RunningJob, in_words


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is set."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def estimate(clock, monkeypatch):
    found = Estimate()
    monkeypatch.setattr(found, "_usual", {"simulate": 20.0, "train": 60.0})
    found.plan({"simulate": 4, "train": 1})
    return found


def test_before_the_first_job_the_default_experiments_times_count(estimate):
    assert estimate.left_s() == 4 * 20 + 60
    estimate.cores = 2
    assert estimate.left_s() == 70
    assert (estimate.done, estimate.total) == (0, 5)


def test_then_the_times_of_the_jobs_that_are_done_count(estimate, clock):
    """Jobs take twice as long as usual, one after another."""
    clock[0] += 80
    estimate.finish("simulate", 42.0)
    estimate.finish("simulate", 38.0)
    assert (estimate.done, estimate.total) == (2, 5)
    slower = (80 + 60) / (40 + 60)  # a minute as usual counts as well
    assert estimate.left_s() == pytest.approx(2 * 40 + slower * 60)


def test_jobs_side_by_side_halve_what_is_left(estimate, clock):
    clock[0] += 40
    estimate.finish("simulate", 40.0)
    estimate.finish("simulate", 40.0)
    assert estimate.left_s() == pytest.approx((2 * 40 + 1.4 * 60) / 2)


def test_what_a_running_job_has_done_is_not_left(estimate, clock):
    clock[0] += 90
    estimate.finish("simulate", 40.0)
    estimate.finish("simulate", 40.0)
    job = RunningJob("simulate", "simulate 3", "", clock[0] - 10)
    assert estimate.left_s([job]) == pytest.approx(30 + 40 + 1.4 * 60)
    late = RunningJob("simulate", "simulate 3", "", clock[0] - 90)
    expected = (40 + 1.4 * 60) / ((80 + 90) / 90)
    assert estimate.left_s([late]) == pytest.approx(expected)


def test_nothing_is_left_at_the_end(estimate, clock):
    clock[0] += 100
    for _ in range(4):
        estimate.finish("simulate", 20.0)
    estimate.finish("train", 20.0)
    assert estimate.left_s() == 0


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.4, "0 s"), (59, "59 s"), (61, "1 min 01 s"), (1200, "20 min"), (7200, "2.0 h")],
)
def test_times_in_words(seconds, words):
    assert in_words(seconds) == words


def test_the_usual_times_are_of_rules_that_there_are():
    usual = json.loads((files("snakemake_logger_plugin_drapeline") / "seconds.json").read_text())
    assert usual["simulate_outfits"] > usual["import_motion"] > 0
