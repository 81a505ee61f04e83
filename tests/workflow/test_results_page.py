"""Tables of results, and what a run takes: written by `docs/write_tables.py`, and only by it."""

import re
import runpy

import pytest

from toys.snakemake_run import ROOT

MAKE = runpy.run_path(str(ROOT / "docs" / "write_tables.py"))
PAGES = {path.name: path.read_text() for path in [*MAKE["PAGES"], MAKE["REFERENCE"]]}
TEXT = "\n".join(PAGES.values())


def test_every_table_has_a_place_that_is_filled():
    blocks = MAKE["BLOCK"].findall(TEXT)
    assert {name for _, name, _ in blocks} == {*MAKE["TABLES"]}
    assert TEXT.count("<!-- table:") == TEXT.count("<!-- end of table -->") == len(blocks)
    for block in MAKE["BLOCK"].finditer(TEXT):
        assert len(block[0].splitlines()) > 3, f"{block[2]} is empty"
    assert "Not measured" not in TEXT


def test_every_figure_has_a_place():
    assert {name for _, name, _ in MAKE["FIGURE"].findall(TEXT)} == {*MAKE["FIGURES"]}


@pytest.mark.parametrize("page", ["results.md", "reference-experiment.md"])
def test_no_measured_number_of_the_results_is_typed_by_hand(page):
    prose = MAKE["BLOCK"].sub("", PAGES[page])
    assert not re.findall(r"\d+\.\d+|\d+ (?:%|mm|s|ms|MB)\b", MAKE["FIGURE"].sub("", prose))


@pytest.mark.parametrize(
    "page", ["README.md", "install.md", "tutorial.md", "results.md", "reference-experiment.md"]
)
def test_no_time_or_disk_of_a_run_is_typed_by_hand(page):
    prose = MAKE["FIGURE"].sub("", MAKE["BLOCK"].sub("", PAGES[page]))
    assert not re.findall(r"\d+(?: to \d+)? (?:GB|jobs|minutes|hours)\b", prose)
