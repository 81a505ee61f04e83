"""The rules of the report, on a dataset with and without accepted samples."""

import pytest
from PIL import Image

from drapeline.dataset.collect import collect_dataset
from drapeline.metrics.table import collect_metrics
from drapeline.report.dataset.health import MEASURES
from drapeline.report.registration_table import SUMMARY
from drapeline.schema import make_table, write_table
from toys.tiny_sample import write_tiny_sample


@pytest.fixture(params=["accepted", "rejected"])
def dataset(request, tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body, status=request.param).folder
    collect_dataset([folder], tmp_path / "dataset")
    return tmp_path / "dataset"


def files(folder, *names):
    return {name.split(".")[0]: folder / "report" / name for name in names}


def test_plot_statistics_draws_every_figure(run_rule, dataset, tmp_path):
    names = ("garments.svg", "actions.svg", "splits.svg", "bodies.svg", "vertices.svg")
    run_rule("plot_statistics", input={"dataset": dataset}, output=files(tmp_path, *names))
    assert {path.name for path in (tmp_path / "report").iterdir()} == set(names)


def test_plot_health_draws_every_measure_and_the_page(run_rule, dataset, tmp_path):
    names = [*(f"{name}.svg" for name in (*MEASURES, "speed")), "page.html"]
    run_rule("plot_health", input={"dataset": dataset}, output=files(tmp_path, *names))
    assert {path.name for path in (tmp_path / "report").iterdir()} == set(names)


def test_tables_and_viewer_are_pages(run_rule, dataset, tmp_path):
    page = tmp_path / "tables.html"
    run_rule("tabulate_dataset", input={"dataset": dataset}, output=[page])
    assert "CLOTH3D, as printed" in page.read_text()
    run_rule("view_example", input={"dataset": dataset}, output=[tmp_path / "example.html"])
    run_rule(
        "view_sample",
        input=[tmp_path / "samples"],
        output=[tmp_path / "sample.html"],
        wildcards={"sample": "00001"},
    )
    assert "<canvas" in (tmp_path / "sample.html").read_text()


def test_plot_time_reads_the_benchmarks(run_rule, tmp_path):
    benchmark = tmp_path / "benchmarks" / "make_outfit" / "00001.tsv"
    benchmark.parent.mkdir(parents=True)
    benchmark.write_text("s\tmax_rss\tmean_load\tcpu_time\n3.5\t200\t80\t3\n")
    output = {
        "figure": tmp_path / "f.svg",
        "page": tmp_path / "p.html",
        "table": tmp_path / "t.tsv",
    }
    params = {"folders": [tmp_path / "benchmarks"], "stages": {"make_outfit/": "outfits"}}
    run_rule("plot_time", output=output, params=params)
    assert "outfits\tmake_outfit\t1\t3.5" in output["table"].read_text()


def test_write_overview_shows_stills_and_samples(run_rule, dataset, tmp_path, capsys):
    still = tmp_path / "gallery" / "00001.png"
    still.parent.mkdir()
    Image.new("RGB", (48, 64), "grey").save(still)
    run_rule(
        "write_overview",
        input={"dataset": dataset, "pictures": [still.parent]},
        output=[tmp_path / "overview.html"],
    )
    assert "<strong>00001</strong>" in (tmp_path / "overview.html").read_text()
    assert "all samples are there to be looked at: " in capsys.readouterr().out


def test_the_first_pictures_are_announced_with_a_page_that_fills_up(
    run_rule, tmp_path, toy_body, capsys
):
    for number, words in (("00001", "drapeline: first pictures: "), ("00002", "")):
        sample = write_tiny_sample(tmp_path / number, toy_body, number, frames=2).folder
        output = tmp_path / "gallery" / "dataset" / number
        run_rule("render_gallery", input=[sample.parent], output=[output], params={"rays": 0.1})
        assert (output / f"{number}_moving.png").is_file()
        said = capsys.readouterr().out
        assert said.startswith(words) if words else not said
    index = (tmp_path / "gallery" / "index.html").read_text()
    assert all(f"{number}_moving.png" in index for number in ("00001", "00002"))


def test_write_errors_shows_numbers(run_rule, tmp_path):
    registration, metrics = tmp_path / "registration.tsv", tmp_path / "metrics.tsv"
    errors = {"source": "static", "garment": "Skirt", "metric": "garment_to_rebuilt_mean_mm"}
    errors |= {"garments": 4, "mean": 0.5, "median": 0.5, "max": 0.5, "total": 2.0, "unit": "mm"}
    write_table(registration, make_table(SUMMARY, [errors]), SUMMARY)
    collect_metrics(metrics, [])
    run_rule(
        "write_errors",
        input={"registration": registration, "metrics": metrics},
        output=[tmp_path / "errors.html"],
    )
    text = (tmp_path / "errors.html").read_text()
    assert "<strong>0.50 mm</strong>mean of 4 garments" in text
