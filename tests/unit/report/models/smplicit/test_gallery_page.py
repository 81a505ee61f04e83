"""The page about codes: its numbers are those of the tables."""

import csv
import re

import pytest

from drapeline.errors import InputError
from drapeline.report.models.smplicit.tables import (
    GalleryTables,
    read_gallery_tables,
    write_correlations,
    write_gallery_page,
)


def garment(sheet, row="", about="", asked="", **values):
    start = {"vertices": "9", "like_training": "true", "inside_share": "0.02"}
    return {"sheet": sheet, "row": row, "about": about, "asked": asked, **start, **values}


TABLES = GalleryTables(
    garments=[
        garment("prototypes", leg="50", width="30"),
        garment("edits", about="leg", asked="40", leg="44", width="33"),
        garment("edits", about="leg", asked="60", leg="58", width="29"),
        garment("samples", row="one", leg="50", width="30"),
        garment("samples", row="one", leg="", width="", vertices="0", like_training="false"),
    ],
    correlations=[
        {"model": "skirt", "axis": axis, "deviation": "0.25", "property": name, "title": title,
         "correlation": value, "garments": "7"}
        for axis, name, title, value in (
            ("1", "leg", "length", "0.987"),
            ("1", "width", "looseness", "-0.123"),
            ("2", "leg", "length", ""),
            ("2", "width", "looseness", "0.5"),
        )
    ],
    regressions=[
        {"model": "skirt", "property": name, "title": title, "about": "what is measured",
         "unit": unit, "explained_share": share, "mean": "55", "deviation": deviation,
         "garments": "7"}
        for name, title, unit, share, deviation in (
            ("leg", "length", "% of the leg", "0.91", "20"),
            ("width", "looseness", "mm", "", "4"),
        )
    ],
)  # fmt: skip


def cells(text):
    """Rows of all tables, as texts of their cells."""
    rows = re.findall(r"<tr>(.*?)</tr>", text, re.DOTALL)
    return [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in rows]


@pytest.fixture
def rows(tmp_path):
    write_gallery_page(tmp_path / "page.html", {"skirt": TABLES})
    return cells((tmp_path / "page.html").read_text())


def test_axes_have_a_row_with_their_correlations(rows):
    assert ["skirt", "1", "0.250", "0.99", "-0.12"] in rows
    assert ["skirt", "2", "0.250", "-", "0.50"] in rows


def test_edits_are_off_by_what_tables_say(rows):
    # |44 - 40| and |58 - 60|; the other property is 31 +- 2, in deviations of 4.
    assert ["skirt", "length", "3.0", "% of the leg", "0.15", "0.50"] in rows


def test_samples_are_counted(rows):
    assert ["skirt", "one", "2", "1", "1", "2.00"] in rows


def test_what_codes_do_not_tell_is_left_open(rows):
    assert ["skirt", "looseness", "what is measured", "mm", "55.0", "4.0", "7", "-"] in rows


def test_correlations_of_all_models_make_one_table(tmp_path):
    write_correlations(tmp_path / "all.tsv", {"skirt": TABLES, "again": TABLES})
    with open(tmp_path / "all.tsv") as stream:
        assert list(csv.DictReader(stream, delimiter="\t")) == [*TABLES.correlations] * 2


def test_tables_are_read_from_their_files(tmp_path):
    for name, rows in TABLES._asdict().items():
        with open(tmp_path / f"{name}.tsv", "w", newline="") as stream:
            columns = list(dict.fromkeys(key for row in rows for key in row))
            writer = csv.DictWriter(stream, columns, delimiter="\t")
            writer.writeheader()
            writer.writerows(rows)
    assert read_gallery_tables(tmp_path) == TABLES
    (tmp_path / "regressions.tsv").unlink()
    with pytest.raises(InputError, match=r"regressions.tsv: no such file"):
        read_gallery_tables(tmp_path)
