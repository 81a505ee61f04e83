"""The page that compares codes."""

import re

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.outfits.garment_types import TEMPLATE_TYPES
from drapeline.report.models.representations import write_representations
from toys.metric_rows import metric_row


def row(variant, garment, value, metric="surface_to_true_mm", split="test"):
    return metric_row(variant, garment, metric, value, model="representation", split=split)


def test_each_code_has_a_row_and_what_was_not_measured_a_dash(tmp_path):
    rows = [
        row("static_ppca", "Skirt", 3.25),
        row("static_ppca", "Skirt", 3.0, "surface_to_true_mm" + LOW),
        row("static_ppca", "Skirt", 3.5, "surface_to_true_mm" + HIGH),
        row("static_ppca", "Skirt", 77.0, split="val"),
        row("garment4d_pca", "all", 4.5),
        *(row("static_ppca", kind, 128, "code_numbers") for kind in TEMPLATE_TYPES),
        row("garment4d_pca", "Skirt", 64, "code_numbers"),
        row("garment4d_pca", "Trousers", 51, "code_numbers"),
    ]
    write_metrics(tmp_path / "metrics.tsv", rows)
    write_representations(tmp_path / "page.html", tmp_path / "metrics.tsv", "test")
    page = (tmp_path / "page.html").read_text()
    assert "3.25 (3.00 to 3.50)" in page
    assert "4.50" in page
    assert "77.00" not in page
    first = page.split("Masked PPCA")[1].split("</tr>")[0]
    assert first.count(">-<") == 3
    assert "128" in first
    assert "64 / - / 51" in page


def test_representations_of_a_further_model_are_shown_under_their_own_names(tmp_path):
    rows = [
        row("implicit_registered", "Skirt", 1.25),
        row("implicit_code", "Skirt", 2.75),
        row("implicit_code", "Skirt", 96, "code_numbers"),
        row("svae", "Skirt", 3.25),
    ]
    write_metrics(tmp_path / "metrics.tsv", rows)
    write_representations(tmp_path / "page.html", tmp_path / "metrics.tsv", "test")
    tables = (tmp_path / "page.html").read_text().split("<table")[1:]
    assert len(tables) == 2  # one for each direction
    first = tables[0].split("<tr>")[2:]
    names = [re.search(r"<t[dh][^>]*>([^<]*)<", line)[1] for line in first]
    assert names.index("SVAE") < names.index("implicit_code")
    assert names.index("implicit_code") < names.index("no code: registered to the body")
    assert names[-1] == "no code: implicit_registered"
    assert "1.25" in first[-1]
    assert "2.75" in first[names.index("implicit_code")]
    assert "96" in first[names.index("implicit_code")]
