"""The table of metrics: what goes in comes out, and what is no metric is refused by name."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.metrics.table import (
    ALL,
    HIGH,
    LOW,
    MetricRow,
    collect_metrics,
    find_value,
    read_metrics,
    summary_rows,
    write_metrics,
)
from drapeline.seeding import rng_for

ROW = MetricRow("svae", "svae", "test", "Dress", "surface_error_mm", 12.5, "mm", 7, 0)


def summarised(values, garments, groups, seed=0):
    return summary_rows(
        rng_for(seed, "intervals"),
        [{"mask_iou": value} for value in values],
        garments,
        groups,
        model="svae",
        variant="svae",
        split="test",
        seed=1,
    )


def test_rows_come_back_as_they_were_written(tmp_path):
    rows = [ROW, ROW._replace(garment="all", metric="surface_error_mm" + LOW, n=9)]
    write_metrics(tmp_path / "m.tsv", rows)
    assert read_metrics(tmp_path / "m.tsv") == rows
    header = (tmp_path / "m.tsv").read_text().splitlines()[0]
    assert header == "model\tvariant\tsplit\tgarment\tmetric\tvalue\tunit\tn\tseed\tsource"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"value": float("nan")}, "svae test Dress surface_error_mm is nan, expected a finite"),
        ({"unit": "m"}, "has the unit 'm', expected 'mm'"),
        ({"metric": "chamfer"}, "chamfer has the unit 'mm', expected 'None'"),
        ({"n": 0}, "n = 0, expected at least 1"),
        ({}, "is there twice"),
    ],
)
def test_rows_that_are_no_metric_are_refused(tmp_path, wrong, message):
    with pytest.raises(InputError, match=message):
        write_metrics(tmp_path / "m.tsv", [ROW, ROW._replace(**wrong)])
    assert not (tmp_path / "m.tsv").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has the columns none"),
        ("model\tvalue\n", "has the columns model, value, expected model, variant"),
        ("\t".join(MetricRow._fields) + "\nsvae\tsvae\n", "line 2 is no row"),
        ("\t".join(MetricRow._fields) + "\na\tb\tc\td\te\tmany\tmm\t1\t0\t\n", "line 2 is no row"),
    ],
)
def test_files_that_are_no_table_are_refused(tmp_path, text, message):
    (tmp_path / "m.tsv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_metrics(tmp_path / "m.tsv")


def test_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.tsv: no such file"):
        read_metrics(tmp_path / "none.tsv")


def test_collecting_keeps_order_and_refuses_doubles(tmp_path):
    first, second = tmp_path / "a.tsv", tmp_path / "b.tsv"
    write_metrics(first, [ROW])
    write_metrics(second, [ROW._replace(variant="static_ppca")])
    assert collect_metrics(tmp_path / "all.tsv", [second, first]) == 2
    assert [r.variant for r in read_metrics(tmp_path / "all.tsv")] == ["static_ppca", "svae"]
    with pytest.raises(InputError, match="twice"):
        collect_metrics(tmp_path / "all.tsv", [first, first])


def test_summary_has_each_type_and_all_with_their_counts():
    rows = summarised([0.2, 0.4, 0.9, np.nan], ["Top", "Top", "Dress", "Dress"], [*"abcd"])
    assert find_value(rows, "svae", "test", ALL, "mask_iou")[5:] == (
        pytest.approx(0.5),
        "1",
        3,
        1,
        "",
    )
    assert find_value(rows, "svae", "test", "Top", "mask_iou").value == pytest.approx(0.3)
    assert find_value(rows, "svae", "test", "Dress", "mask_iou").n == 1
    assert find_value(rows, "svae", "test", "Top", "mask_iou" + LOW) is None  # of two: none


def test_intervals_are_over_groups_and_reproducible():
    rng = rng_for(3, "values")
    group = np.repeat(np.arange(25), 40)
    # All of a group share one value: 1000 garments tell no more than 25 groups do.
    values = rng.normal(size=25)[group]
    rows = summarised(values, ["Top"] * 1000, group)
    low, high = (
        find_value(rows, "svae", "test", ALL, "mask_iou" + end).value for end in (LOW, HIGH)
    )
    expected = 2 * 1.96 * values.std() / np.sqrt(25)
    assert high - low == pytest.approx(expected, rel=0.25)
    assert low < values.mean() < high
    assert rows == summarised(values, ["Top"] * 1000, group)
    # Independent garments give a far narrower one.
    alone = summarised(values, ["Top"] * 1000, np.arange(1000))
    width = np.subtract(
        *(find_value(alone, "svae", "test", ALL, "mask_iou" + e).value for e in (HIGH, LOW))
    )
    assert width < 0.3 * (high - low)


def ends(rows):
    return [find_value(rows, "svae", "test", ALL, "mask_iou" + end).value for end in (LOW, HIGH)]


def test_an_interval_is_two_deviations_of_the_mean_to_either_side():
    values = rng_for(4, "values").normal(size=400)
    low, high = ends(summarised(values, ["Top"] * 400, np.arange(400)))
    deviation = values.std() / np.sqrt(400)
    assert (high - low) / (2 * deviation) == pytest.approx(1.96, rel=0.07)
    assert (high + low) / 2 == pytest.approx(values.mean(), abs=0.2 * deviation)


def test_an_interval_is_about_the_mean_of_garments_where_groups_differ_in_size():
    size = np.array([9, 1] * 20)
    values, group = np.repeat([0.0, 10.0] * 20, size), np.repeat(np.arange(40), size)
    low, high = ends(summarised(values, ["Top"] * len(values), group))
    assert values.mean() == 1
    assert 0 < low < 1 < high < 3
