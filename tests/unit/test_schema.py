"""Tables with a declared schema: what goes in comes out, and what does not fit is named."""

import math

import pandas as pd
import pytest

from drapeline.errors import InputError
from drapeline.schema import (
    Column,
    Schema,
    check_table,
    make_table,
    read_table,
    typed,
    write_parquet,
    write_table,
)

FRUIT = Schema(
    "a table of fruit",
    {
        "name": Column(),
        "kind": Column(allowed=("pome", "berry")),
        "count": Column(int, low=0),
        "kg": Column(float, text=".3f"),
        "price": Column(float, optional=True, text=".2f"),
    },
    key=("name",),
)
APPLE = {"name": "apple", "kind": "pome", "count": 3, "kg": 0.25, "price": 1.5}
HEADING = "name\tkind\tcount\tkg\tprice\n"


def test_a_written_table_is_read_back_with_its_types(tmp_path):
    pear = {"name": "pear", "kind": "pome", "count": 0, "kg": 1.0}
    write_table(tmp_path / "t.tsv", make_table(FRUIT, [APPLE, pear]), FRUIT)
    assert (tmp_path / "t.tsv").read_text() == (
        HEADING + "apple\tpome\t3\t0.250\t1.50\npear\tpome\t0\t1.000\t\n"
    )
    first, second = read_table(tmp_path / "t.tsv", FRUIT).to_dict("records")
    assert first == APPLE
    assert math.isnan(second["price"])


def test_a_table_without_rows_has_its_columns(tmp_path):
    write_table(tmp_path / "t.tsv", make_table(FRUIT, []), FRUIT)
    assert (tmp_path / "t.tsv").read_text() == HEADING
    assert list(read_table(tmp_path / "t.tsv", FRUIT)) == list(FRUIT.columns)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"kind": "nut"}, r"t.tsv: line 3 \(fig\): kind is 'nut', expected one of pome, berry"),
        ({"count": -1}, "count is '-1', expected a whole number, at least 0"),
        ({"kg": math.nan}, "kg is 'nan', expected a finite number"),
        ({"kg": math.inf}, "kg is 'inf', expected a finite number"),
        ({"name": "apple"}, r"t.tsv: line 3 \(apple\) is there twice, expected once"),
    ],
)
def test_a_value_that_does_not_fit_is_named_with_file_line_and_column(wrong, message):
    table = make_table(FRUIT, [APPLE, APPLE | {"name": "fig"} | wrong])
    with pytest.raises(InputError, match=message):
        check_table(FRUIT, table, "t.tsv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name\tkind\n", "t.tsv: lacks column count, kg, price; it has name, kind"),
        ("", "t.tsv: lacks column name, kind, count, kg, price; it has none"),
        (HEADING[:-1] + "\tcolour\n", "t.tsv: has column colour, expected name, kind"),
        (HEADING + "a\tpome\tmany\t1\t1\n", "line 2: count is 'many', expected a whole number"),
        (HEADING + f"a\tpome\t{10**30}\t1\t1\n", "line 2: count is '10+', expected a whole number"),
        (HEADING + "a\tpome\t1\theavy\t1\n", "line 2: kg is 'heavy', expected a number"),
    ],
)
def test_a_file_that_does_not_fit_is_named(tmp_path, text, message):
    (tmp_path / "t.tsv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_table(tmp_path / "t.tsv", FRUIT)


def test_further_columns_are_text_where_a_schema_allows_them(tmp_path):
    open_schema = FRUIT._replace(more=True)
    table = make_table(open_schema, [APPLE | {"colour": "red"}])
    write_table(tmp_path / "t.tsv", table, open_schema)
    assert read_table(tmp_path / "t.tsv", open_schema)["colour"].tolist() == ["red"]


def test_further_columns_become_numbers_where_all_of_their_values_are(tmp_path):
    open_schema = FRUIT._replace(more=True)
    rows = [
        APPLE | {"name": "007", "width": "0.25", "ripe": "3", "hue": "1", "origin": "12"},
        APPLE | {"name": "008", "width": "1e-3", "ripe": "4", "hue": "", "origin": "Kent"},
    ]
    write_table(tmp_path / "t.tsv", make_table(open_schema, rows), open_schema)
    table = read_table(tmp_path / "t.tsv", open_schema)
    write_parquet(tmp_path / "t.parquet", typed(table, open_schema))
    found = pd.read_parquet(tmp_path / "t.parquet")
    assert found["name"].tolist() == ["007", "008"]
    assert found["width"].tolist() == [0.25, 0.001]
    assert found["ripe"].tolist() == [3, 4]
    assert found["hue"].isna().tolist() == [False, True]
    assert found["hue"][0] == 1
    assert found["origin"].tolist() == ["12", "Kent"]
    for name in ("count", "kg", "price"):
        assert found[name].tolist() == [APPLE[name]] * 2


def test_a_parquet_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"t\.parquet: cannot be written .*expected a writable"):
        write_parquet(tmp_path / "file" / "t.parquet", make_table(FRUIT, [APPLE]))
