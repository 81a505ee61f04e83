"""Tab-separated tables, written and read."""

import pytest

from drapeline.dataset.tables import read_table, write_table
from drapeline.errors import InputError


def test_a_table_keeps_one_line_per_row(tmp_path):
    write_table(tmp_path / "t.tsv", [{"a": "two\nlines\tand a tab"}, {"a": 1, "b": "x"}])
    assert (tmp_path / "t.tsv").read_text() == "a\tb\ntwo lines and a tab\t\n1\tx\n"


def test_a_written_table_is_read_back_as_text(tmp_path):
    write_table(tmp_path / "t.tsv", [{"a": 1, "b": "x y"}, {"a": 2.5}])
    assert read_table(tmp_path / "t.tsv", ("a", "b")) == [
        {"a": "1", "b": "x y"},
        {"a": "2.5", "b": ""},
    ]


def test_a_table_without_rows_needs_no_columns(tmp_path):
    write_table(tmp_path / "t.tsv", [])
    assert read_table(tmp_path / "t.tsv", ("a",)) == []


def test_a_missing_column_or_file_is_named(tmp_path):
    write_table(tmp_path / "t.tsv", [{"a": 1, "b": 2}])
    with pytest.raises(InputError, match="t.tsv: lacks column c, d; it has a, b"):
        read_table(tmp_path / "t.tsv", ("a", "c", "d"))
    with pytest.raises(InputError, match="none.tsv: no such file"):
        read_table(tmp_path / "none.tsv")
