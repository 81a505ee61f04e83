import csv

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.report.times import duration, job_times, rule_times, write_times

HEADER = "s\th:m:s\tmax_rss\tmax_vms\tmax_uss\tmax_pss\tio_in\tio_out\tmean_load\tcpu_time\n"


def write_benchmark(path, seconds, memory=100.0, cpu=None, load=50):
    path.parent.mkdir(parents=True, exist_ok=True)
    cpu = seconds if cpu is None else cpu
    path.write_text(f"{HEADER}{seconds}\t0:00:00\t{memory}\t0\t0\t0\t0\t0\t{load}\t{cpu}\n")


@pytest.fixture
def folders(tmp_path):
    write_benchmark(tmp_path / "a/simulate_outfits/dataset_00001.tsv", 20.5, 300, 19)
    write_benchmark(tmp_path / "a/simulate_outfits/fast_00001.tsv", 40.25, 500, 38)
    write_benchmark(tmp_path / "a/collect_dataset.tsv", 0.5, "NA", "NA", "NA")
    write_benchmark(tmp_path / "b/copy_body.tsv", 30, 1400, 12)
    return [tmp_path / "a", tmp_path / "b", tmp_path / "not there"]


STAGES = {"simulate_outfits/": "simulation", "copy_body/": "bodies", "copy/": "other"}


def test_jobs_of_a_rule_add_up(folders):
    times = rule_times(job_times(folders, STAGES)).set_index("rule")
    assert [*times.index] == ["simulate_outfits", "copy_body", "collect_dataset", *["all"] * 4]
    assert [*times["stage"]] == 2 * ["simulation", "bodies", "collect_dataset"] + ["all"]
    simulation = times.loc["simulate_outfits"]
    assert simulation["total_s"] == pytest.approx(60.75)
    assert simulation["peak_memory_mb"] == 500
    assert np.isnan(times.loc["collect_dataset", "peak_memory_mb"])
    assert times.loc["collect_dataset", "cpu_s"] == 0


def test_jobs_of_a_rule_may_be_of_several_stages(folders):
    stages = {**STAGES, "simulate_outfits/fast_": "quick simulation"}
    jobs = job_times(folders, stages)
    assert dict(zip(jobs["s"], jobs["stage"], strict=True)) == {
        20.5: "simulation",
        40.25: "quick simulation",
        0.5: "collect_dataset",
        30: "bodies",
    }


def test_processor_time_is_carried_on_to_the_end_of_a_job(tmp_path):
    # Last looked at after 20 of 40 seconds; and one that was quick at first.
    write_benchmark(tmp_path / "train.tsv", 40, cpu=18, load=90)
    write_benchmark(tmp_path / "plot.tsv", 2, cpu=1.5, load=50)
    jobs = job_times([tmp_path], {}).set_index("rule")
    assert jobs["cpu_s"].to_dict() == {"train": 36, "plot": 1.5}


def test_sums_are_those_of_the_rules(folders):
    times = rule_times(job_times(folders, STAGES))
    rules = times[times["rule"] != "all"].to_dict("records")
    *stages, total = times[times["rule"] == "all"].to_dict("records")
    for key in ("jobs", "total_s", "cpu_s"):
        for rows in (rules, stages):
            assert total[key] == pytest.approx(sum(row[key] for row in rows))
    assert total["total_s"] == pytest.approx(20.5 + 40.25 + 0.5 + 30)
    assert (total["longest_s"], total["peak_memory_mb"]) == (40.25, 1400)


def test_figure_table_and_page_show_the_same(folders, tmp_path):
    jobs = job_times(folders, STAGES)
    paths = {name: tmp_path / name for name in ("figure.svg", "table.tsv", "page.html")}
    write_times(jobs, figure=paths["figure.svg"], table=paths["table.tsv"], page=paths["page.html"])
    with open(paths["table.tsv"], newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    assert [row["rule"] for row in rows] == rule_times(jobs)["rule"].tolist()
    for name in ("figure.svg", "page.html"):
        text = paths[name].read_text()
        for word in ("simulate_outfits", "copy_body", "1 min 01 s"):
            assert word in text


def test_no_benchmark_gives_an_empty_table_and_a_figure_that_says_so(tmp_path):
    paths = {name: tmp_path / name for name in ("figure", "table", "page")}
    paths["figure"] = tmp_path / "figure.svg"
    write_times(job_times([tmp_path / "none"], {}), **paths)
    assert "No benchmark yet" in paths["figure"].read_text()
    assert "<p>None.</p>" in paths["page"].read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("s\tcpu_time\n1\t1\n", "x.tsv: lacks column max_rss, mean_load; it has s, cpu_time"),
        (HEADER + "fast" + "\t0" * 9 + "\n", "x.tsv: line 2: s is 'fast', expected a number"),
    ],
)
def test_unusable_benchmarks_are_named(tmp_path, text, message):
    (tmp_path / "x.tsv").write_text(text)
    with pytest.raises(InputError, match=message):
        job_times([tmp_path], {})


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(3.24, "3.2 s"), (65, "1 min 05 s"), (119.7, "2 min 00 s"), (7380, "2 h 03 min")],
)
def test_durations_read_well(seconds, text):
    assert duration(seconds) == text
