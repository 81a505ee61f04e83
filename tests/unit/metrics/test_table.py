"""The table of metrics: what goes in comes out, and what is no metric is refused by name."""

import numpy as np
import pandas as pd
import pytest

from drapeline.errors import InputError
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import (
    ALL,
    HIGH,
    LOW,
    METRICS,
    collect_metrics,
    read_metrics,
    summarise,
    with_intervals,
    write_metrics,
)
from drapeline.seeding import rng_for
from toys.metric_rows import find_value, metric_row, metric_table

ROW = metric_row("svae", "Dress", "surface_error_mm", 12.5, model="svae", n=7)
HEADING = "\t".join(METRICS.columns)


def summarised(values, garments, groups, sources=None, seed=1):
    measured = [
        Measured(group, garment, {"mask_iou": value}, source)
        for value, garment, group, source in zip(
            values, garments, groups, sources or [""] * len(values), strict=True
        )
    ]
    return summarise(measured, model="svae", variant="svae", split="test", seed=seed)


def test_rows_come_back_as_they_were_written(tmp_path):
    low = ROW | {"garment": "all", "metric": "surface_error_mm" + LOW, "n": 9}
    table = metric_table([ROW, low])
    write_metrics(tmp_path / "m.tsv", table)
    pd.testing.assert_frame_equal(read_metrics(tmp_path / "m.tsv"), table)
    assert (tmp_path / "m.tsv").read_text().splitlines()[0] == (
        "model\tvariant\tsplit\tgarment\tmetric\tvalue\tunit\tn\tseed\tsource"
    )


def test_a_table_may_have_no_rows(tmp_path):
    write_metrics(tmp_path / "m.tsv", metric_table([]))
    pd.testing.assert_frame_equal(read_metrics(tmp_path / "m.tsv"), metric_table([]))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"value": float("nan")},
            r"m.tsv: line 3 \(svae svae .*\): value is 'nan', expected a fin",
        ),
        ({"unit": "m"}, "line 3: surface_error_mm has the unit 'm', expected 'mm'"),
        ({"metric": "chamfer"}, "chamfer has the unit 'mm', expected '1'"),
        ({"n": 0}, "n is '0', expected a whole number, at least 1"),
        ({"split": "dev"}, "split is 'dev', expected one of train, val, test, scans"),
        ({"garment": "Dress"}, "is there twice, expected once"),
    ],
)
def test_rows_that_are_no_metric_are_refused(tmp_path, wrong, message):
    with pytest.raises(InputError, match=message):
        write_metrics(tmp_path / "m.tsv", metric_table([ROW, ROW | {"garment": "Top"} | wrong]))
    assert not (tmp_path / "m.tsv").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lacks column model, variant, .*; it has none"),
        ("model\tvalue\n", "lacks column variant, split, .*; it has model, value"),
        (HEADING + "\textra\n", "has column extra, expected model, variant"),
        (HEADING + "\nsvae\tsvae\n", "line 2: value is '', expected a number"),
        (HEADING + "\na\tb\tc\td\te\tmany\tmm\t1\t0\t\n", "line 2: value is 'many', expected a n"),
        (HEADING + "\na\tb\ttest\td\te\t1\tmm\t1.5\t0\t\n", "line 2: n is '1.5', expected a whole"),
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
    write_metrics(first, metric_table([ROW]))
    write_metrics(second, metric_table([ROW | {"variant": "static_ppca"}]))
    assert collect_metrics(tmp_path / "all.tsv", [second, first]) == 2
    assert read_metrics(tmp_path / "all.tsv")["variant"].tolist() == ["static_ppca", "svae"]
    with pytest.raises(InputError, match="twice"):
        collect_metrics(tmp_path / "all.tsv", [first, first])


def test_summary_has_each_type_and_all_with_their_counts():
    rows = summarised([0.2, 0.4, 0.9, np.nan], ["Top", "Top", "Dress", "Dress"], [*"abcd"])
    whole = find_value(rows, "svae", "test", ALL, "mask_iou")
    assert whole.value == pytest.approx(0.5)
    assert tuple(whole[["unit", "n", "seed", "source"]]) == ("1", 3, 1, "")
    assert find_value(rows, "svae", "test", "Top", "mask_iou").value == pytest.approx(0.3)
    assert find_value(rows, "svae", "test", "Dress", "mask_iou").n == 1
    assert find_value(rows, "svae", "test", "Top", "mask_iou" + LOW) is None  # of two: none


def test_a_measure_of_all_garments_together_has_one_row_without_an_interval():
    measured = [
        Measured(f"s{k}", "Dress", {"surface_error_mm": 1.0 + k}, "ab"[k % 2]) for k in range(6)
    ]
    table = summarise(
        measured, model="svae", variant="a", split="test", seed=0, of_all={"active_units": 7}
    )
    (found,) = table[table["metric"].str.startswith("active_units")].itertuples()
    assert (found.garment, found.value, found.n, found.source) == (ALL, 7, 6, "")
    plain = summarise(measured, model="svae", variant="a", split="test", seed=0)
    pd.testing.assert_frame_equal(table[table["metric"] != "active_units"], plain)


def test_nothing_measured_has_no_rows():
    assert len(summarised([], [], [])) == 0
    nothing = summarise(
        [], model="svae", variant="a", split="test", seed=0, of_all={"active_units": 0}
    )
    assert len(nothing) == 0


def test_samples_of_several_solvers_have_rows_of_their_own_besides_those_of_all():
    values, sources = [0.1, 0.2, 0.6], ["blender", "xpbd", "xpbd"]
    rows = summarised(values, ["Top"] * 3, [*"abc"], sources)
    found = {
        source: find_value(rows, "svae", "test", ALL, "mask_iou", source)
        for source in ("", "blender", "xpbd")
    }
    assert {source: (row.value, row.n) for source, row in found.items()} == {
        "": (pytest.approx(0.3), 3),
        "blender": (pytest.approx(0.1), 1),
        "xpbd": (pytest.approx(0.4), 2),
    }
    alone = summarised(values[1:], ["Top"] * 2, [*"bc"], sources[1:])
    assert set(alone["source"]) == {""}


def test_an_interval_stands_beside_its_value():
    table = summarised([0.1, 0.2, 0.6, 0.5], ["Top"] * 3 + ["Dress"], [*"abcd"])
    rows = with_intervals(table).set_index("garment")
    assert not rows["metric"].str.endswith((LOW, HIGH)).any()
    for garment in (ALL, "Top"):
        for column, end in (("low", LOW), ("high", HIGH)):
            expected = find_value(table, "svae", "test", garment, "mask_iou" + end).value
            assert rows.loc[garment, column] == expected
    assert rows.loc["Dress", ["low", "high"]].isna().all()


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
    pd.testing.assert_frame_equal(rows, summarised(values, ["Top"] * 1000, group))
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
