"""Errors of registration, summed up over garments."""

import pytest

from drapeline.errors import InputError
from drapeline.registration.error_table import FILE_NAME, Measure, error_rows, write_errors
from drapeline.report.registration_table import (
    ERRORS,
    SUMMARY,
    TARGET_MM,
    summarise_errors,
    write_registration_tables,
)
from drapeline.schema import make_table, read_table


def errors(garment, name, millimetres, holes):
    measures = [
        Measure("garment_to_rebuilt_mean_mm", millimetres, "mm"),
        Measure("holes_after", holes, "count"),
    ]
    return error_rows(garment, name, measures)


def test_a_summary_has_mean_median_largest_and_sum_of_each_type():
    rows = [*errors("Skirt", "a", 1.0, 0), *errors("Skirt", "b", 2.0, 1)]
    rows += [*errors("Skirt", "c", 6.0, 3), *errors("Top", "a", 0.5, 0)]
    table = summarise_errors(make_table(ERRORS, rows), "static")
    summary = {(r["garment"], r["metric"]): r for r in table.to_dict("records")}
    assert len(summary) == 4
    skirt = summary["Skirt", "garment_to_rebuilt_mean_mm"]
    assert [skirt[k] for k in ("garments", "mean", "median", "max")] == [3, 3, 2, 6]
    assert summary["Skirt", "holes_after"]["total"] == 4
    assert summary["Top", "holes_after"]["source"] == "static"


@pytest.fixture
def files(tmp_path):
    """Of a shard at rest, which has a table, and of one in motion, whose samples have their own."""
    rest, moving = tmp_path / "rest", tmp_path / "moving"
    write_errors(rest / FILE_NAME, errors("Skirt", "a", 0.9 * TARGET_MM, 0))
    write_errors(moving / "s1" / FILE_NAME, errors("Top", "s1", 1.1 * TARGET_MM, 2))
    (moving / "s2").mkdir()  # a rejected sample
    return {"static": [rest], "dataset": [moving]}


def test_table_and_page_hold_all_groups_and_judge_against_the_target(files, tmp_path):
    write_registration_tables(tmp_path / "t.tsv", tmp_path / "p.html", files)
    rows = read_table(tmp_path / "t.tsv", SUMMARY)
    assert list(zip(rows["source"], rows["garment"], strict=True)) == [
        *[("static", "Skirt")] * 2,
        *[("dataset", "Top")] * 2,
    ]
    static, samples = (tmp_path / "p.html").read_text().split("<h2>Group dataset")
    assert 'number good">2.70' in static
    assert 'number bad">3.30' in samples
    assert 'number bad">2<' in samples


def test_a_table_without_its_columns_is_refused(files, tmp_path):
    (files["static"][0] / FILE_NAME).write_text("garment\tvalue\nSkirt\t1\n")
    with pytest.raises(InputError, match=f"{FILE_NAME}: lacks column name, metric, unit"):
        write_registration_tables(tmp_path / "t.tsv", tmp_path / "p.html", files)
