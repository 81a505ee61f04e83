"""The page of results: its tables are written by `docs/write_tables.py`, and only by it."""

import re
import runpy

from toys.snakemake_run import ROOT

MAKE = runpy.run_path(str(ROOT / "docs" / "write_tables.py"))
PAGE = MAKE["PAGE"].read_text()


def test_every_table_has_a_place_that_is_filled():
    blocks = MAKE["BLOCK"].findall(PAGE)
    assert sorted(name for _, name, _ in blocks) == sorted(MAKE["TABLES"])
    assert PAGE.count("<!-- table:") == PAGE.count("<!-- end of table -->") == len(blocks)
    for block in MAKE["BLOCK"].finditer(PAGE):
        assert len(block[0].splitlines()) > 3, f"{block[2]} is empty"
    assert "Not measured" not in PAGE


def test_no_measured_number_is_typed_by_hand():
    prose = MAKE["BLOCK"].sub("", PAGE)
    assert not re.findall(r"\d+\.\d+|\d+ (?:%|mm|s|ms|MB)\b", prose)
